// Files on disk, read whole and refused kindly.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

namespace mbdae::reading {

/// No deck is that long; something else was given by mistake.
inline constexpr std::size_t kLargestFile = std::size_t{64} << 20;  // 64 MiB

/// Reads a text file; on failure returns false and says why in `problem` ("no such file", ...).
bool load_text(const std::string& path, std::string* text, std::string* problem);

/// Checks a text already in memory: size, zero bytes.
bool check_text(const std::string& text, std::string* problem);

/// `name` as seen from the file `from` (absolute names stay).
std::string relative_to(const std::string& from, const std::string& name);

/// True if there is such a directory; an empty name is the present one.
bool is_directory(const std::string& path);

/// The same file under any of its names gives the same result.
std::string canonical_name(const std::string& path);

}  // namespace mbdae::reading
