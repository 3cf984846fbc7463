// A small HDF5 file built in memory and put on disk in one step: a reader never sees half a file.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace mbdae {

/// A file cannot be read or written. The message names the file and the reason the system gave.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Owns an HDF5 handle of any kind and closes it.
class Hdf5Handle {
 public:
  using Closer = int (*)(std::int64_t);

  /// Throws FileError when `id` is HDF5's error value.
  Hdf5Handle(std::int64_t id, Closer closer, const char* what);
  ~Hdf5Handle();
  Hdf5Handle(Hdf5Handle&& other) noexcept;
  Hdf5Handle(const Hdf5Handle&) = delete;
  Hdf5Handle& operator=(const Hdf5Handle&) = delete;
  Hdf5Handle& operator=(Hdf5Handle&&) = delete;

  std::int64_t id() const { return id_; }

 private:
  std::int64_t id_;
  Closer closer_;
};

/// A group of the file under construction. Every dataset carries HDF5's Fletcher-32 checksum, which every reader of
/// HDF5 verifies.
class Hdf5Group {
 public:
  explicit Hdf5Group(Hdf5Handle handle) : handle_(std::move(handle)) {}

  Hdf5Group group(const std::string& name);

  void attribute(const std::string& name, const std::string& text);
  void attribute(const std::string& name, const std::array<int, 2>& values);
  void attribute(const std::string& name, double value);

  /// Matrix[rows][columns], stored row-major.
  void dataset(const std::string& name, const Eigen::MatrixXd& matrix);
  /// `values` in row-major order with the given dimensions.
  void dataset(const std::string& name, std::span<const double> values, std::span<const std::uint64_t> dimensions);
  void dataset(const std::string& name, const std::vector<double>& values);
  void dataset(const std::string& name, std::span<const std::uint64_t> values,
               std::span<const std::uint64_t> dimensions);
  /// Fixed-length, null-padded strings as long as the longest.
  void dataset(const std::string& name, const std::vector<std::string_view>& texts);

 private:
  void write(const std::string& name, std::int64_t type, const void* data, std::span<const std::uint64_t> dimensions);
  void write_attribute(const std::string& name, std::int64_t type, std::int64_t memory_type, const void* data,
                       std::span<const std::uint64_t> dimensions);

  Hdf5Handle handle_;
};

/// The file under construction.
class Hdf5File {
 public:
  /// Starts an empty file in memory, expected to become about `expected_bytes` large.
  explicit Hdf5File(std::size_t expected_bytes);

  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;

  Hdf5Group& root() { return root_; }

  /// The file's bytes as they stand; valid until the file changes.
  std::span<const char> image();
  /// Where in the image the values of a dataset begin, a multiple of 8. Throws FileError if they are not in one piece.
  std::size_t offset(const std::string& dataset);

  /// Writes the image by `write_file`.
  void save(const std::string& path);

 private:
  Hdf5Handle file_;
  Hdf5Group root_;
};

/// Writes `path`.part and renames it to `path`. Throws FileError; then `path` is as it was before.
void write_file(const std::string& path, std::span<const char> bytes);

/// One member of every element of a list, for a dataset: column(model.dofs, &UnknownInfo::owner). Texts are
/// not copied.
template <typename Item, typename Value>
auto column(const std::vector<Item>& items, Value Item::*member) {
  std::vector<std::conditional_t<std::is_same_v<Value, std::string>, std::string_view, Value>> values;
  values.reserve(items.size());
  for (const Item& item : items) values.push_back(item.*member);
  return values;
}

/// Reads the state, the first column of dataset `vectors`, of a matrices file; checksums are the business of
/// whoever reads all of it. Throws FileError saying what is wrong
/// with the file.
Eigen::VectorXd read_state(const std::string& path);

}  // namespace mbdae
