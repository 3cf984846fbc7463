// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/source.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <system_error>

namespace mbdae::reading {
namespace fs = std::filesystem;

bool check_text(const std::string& text, std::string* problem) {
  if (text.size() > kLargestFile) {
    *problem = "the file is larger than 64 MiB, this is not a deck";
    return false;
  }
  if (text.find('\0') != std::string::npos) {
    *problem = "this is a binary file (it has zero bytes), expected a deck in plain text";
    return false;
  }
  return true;
}

bool load_text(const std::string& path, std::string* text, std::string* problem) {
  std::error_code error;
  if (path.find('\0') != std::string::npos) {
    *problem = "no such file";
    return false;
  }
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) {
    *problem = status.type() == fs::file_type::not_found ? "no such file" : "cannot be opened: " + error.message();
    return false;
  }
  if (fs::is_directory(status)) {
    *problem = "this is a directory, expected a deck";
    return false;
  }
  if (!fs::is_regular_file(status)) {
    *problem = fs::is_fifo(status) ? "this is a FIFO, expected a regular file"
                                   : "this is a device or a socket, expected a regular file";
    return false;
  }
  const auto close = [](std::FILE* file) { std::fclose(file); };
  const std::unique_ptr<std::FILE, decltype(close)> file(std::fopen(path.c_str(), "rb"), close);
  if (!file) {
    *problem = std::string("cannot be opened: ") + std::strerror(errno);
    return false;
  }
  text->clear();
  // Not by its size: a pipe has none, and a special file may never end.
  std::size_t got = 0;
  do {
    const std::size_t had = text->size();
    const std::size_t chunk = had == 0 ? std::size_t{1} << 16 : had;
    text->resize(had + chunk);
    got = std::fread(text->data() + had, 1, chunk, file.get());
    text->resize(had + got);
  } while (got > 0 && text->size() <= kLargestFile);
  if (std::ferror(file.get()) != 0) {
    *problem = std::string("cannot be read: ") + std::strerror(errno);
    return false;
  }
  return check_text(*text, problem);
}

std::string relative_to(const std::string& from, const std::string& name) {
  const fs::path path(name);
  if (path.is_absolute()) return name;
  return (fs::path(from).parent_path() / path).string();
}

bool is_directory(const std::string& path) {
  std::error_code error;
  return fs::is_directory(path.empty() ? "." : path, error);
}

std::string canonical_name(const std::string& path) {
  std::error_code error;
  const fs::path canonical = fs::weakly_canonical(path, error);
  return error ? path : canonical.string();
}

}  // namespace mbdae::reading
