// The table of elements: one row per type. Where a new one is added.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mbdae/deck/reader.h"

namespace mbdae {

ElementTable element_table();

/// The row of elements with these data; a type that several cards share has the first of them.
template <class Data>
const ElementType* element_type() {
  for (const ElementType& row : element_table()) {
    if (*row.data == typeid(Data)) return &row;
  }
  return nullptr;
}

/// Reads a deck and the files it includes, with every element of the table.
inline ReadResult read_deck_file(const std::string& path) { return read_deck_file(path, element_table()); }

/// Reads a deck from memory; `name` is used in messages and its directory for relative includes.
inline ReadResult read_deck_text(const std::string& text, const std::string& name) {
  return read_deck_text(text, name, element_table());
}

}  // namespace mbdae
