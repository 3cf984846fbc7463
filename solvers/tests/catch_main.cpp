// The main function that every test executable shares.
//
// SPDX-License-Identifier: BSD-3-Clause
#define CATCH_CONFIG_MAIN
#include <catch2/catch.hpp>

namespace {

// Digits behind the point that failures and `-s` print: errors near round-off must not read 0.0.
[[maybe_unused]] const int kDigits = Catch::StringMaker<double>::precision = 17;

}  // namespace
