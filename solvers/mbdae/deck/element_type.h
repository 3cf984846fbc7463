// A row of the table of elements: how a card is read, what it becomes, what it counts as.
//
// The table itself is elements/table.cpp. Reading knows of mechanics only that a row can make an Element.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <any>
#include <memory>
#include <span>
#include <typeinfo>

namespace mbdae {

class Element;
struct Numbering;
struct SourcePosition;
namespace reading {
struct Context;
}

/// The word before the colon: `joint: label, TYPE, ...;`
enum class CardKind { joint, genel, force, couple };

struct ElementType {
  CardKind card;
  const char* name;            ///< the type as decks and files write it: "spherical hinge"
  const char* alias;           ///< another spelling that decks may use, or null
  const char* counts_as;       ///< in the summary of a check: "joints", "deformable", "rods", "muscles", "forces"
  const std::type_info* data;  ///< type of what the reader returns

  /// Reads what follows the type; `where` is the type's place, for messages about the card as a whole.
  std::any (*read)(reading::Context& context, const SourcePosition& where);
  /// The element's mechanics.
  std::unique_ptr<Element> (*make)(const std::any& data, const Numbering& numbering);
  /// For elements that count differently from case to case; may be null.
  const char* (*counts)(const std::any& data);
  /// Number of unknowns of its own beside reactions (states and algebraic values), in these data; null for none.
  int (*scalars)(const std::any& data);
  /// Names of what `element` drives may read of it.
  std::span<const char* const> signals;
  /// For elements that own displacements and velocities beside reactions: how many of each; may be null.
  int (*coordinates)(const std::any& data);
};

/// All rows. They live as long as the program.
using ElementTable = std::span<const ElementType>;

}  // namespace mbdae
