// A small HDF5 file built in memory and put on disk in one step: a reader never sees half a file.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <exception>
#include <optional>
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

/// A file that is filled again does not have the structure of the first time.
class Hdf5StructureDiffers : public std::exception {};

/// What the file holds, in the order in which it was put there; needed to fill it again.
struct Hdf5Record {
  struct Dataset {
    std::string path;
    char kind;  ///< 'f' numbers, 'i' integers, 'S' texts
    std::vector<std::uint64_t> dimensions;
    std::size_t bytes;
    std::uint64_t offset;  ///< in the file
  };
  struct Attribute {
    std::string name;
    std::string value;                 ///< its bytes
    std::optional<Hdf5Handle> handle;  ///< while refilling, once it has changed
  };
  std::vector<Dataset> datasets;
  std::vector<Attribute> attributes;
  bool refilling = false;
  std::size_t next_dataset = 0, next_attribute = 0;
  std::span<char> image;  ///< the file in memory as it was saved last
};

/// A group of the file under construction. Names of datasets are relative to it.
class Hdf5Group {
 public:
  /// `prefix` is the group's path, empty for the root and ending in '/' below it; `handle` is empty while refilling.
  Hdf5Group(std::optional<Hdf5Handle> handle, Hdf5Record& record, std::string prefix)
      : handle_(std::move(handle)), record_(&record), prefix_(std::move(prefix)) {}

  Hdf5Group group(const std::string& name);

  void attribute(const std::string& name, const std::string& text);
  void attribute(const std::string& name, const std::array<int, 2>& values);
  void attribute(const std::string& name, double value);

  void dataset(const std::string& name, double value);
  void dataset(const std::string& name, const Eigen::VectorXd& values);
  /// Matrix[rows][columns], stored row-major.
  void dataset(const std::string& name, const Eigen::MatrixXd& matrix);
  /// `values` in row-major order with the given dimensions.
  void dataset(const std::string& name, std::span<const double> values, std::span<const std::uint64_t> dimensions);
  void dataset(const std::string& name, const std::vector<double>& values);
  void dataset(const std::string& name, const std::vector<int>& values);
  /// Fixed-length, null-padded strings as long as the longest.
  void dataset(const std::string& name, const std::vector<std::string_view>& texts);

 private:
  /// While refilling: where in the image the values of the next dataset are, which must be this one.
  char* place(const std::string& name, char kind, std::size_t bytes, std::span<const std::uint64_t> dimensions);
  /// While refilling: true if the next attribute, which must be this one, has that value already.
  bool has_attribute(const std::string& name, const void* data, std::size_t bytes);
  void write(const std::string& name, char kind, std::int64_t type, std::size_t item_bytes, const void* data,
             std::span<const std::uint64_t> dimensions);
  void write_attribute(const std::string& name, std::int64_t type, std::int64_t memory_type, const void* data,
                       std::size_t bytes, std::span<const std::uint64_t> dimensions);

  std::optional<Hdf5Handle> handle_;
  Hdf5Record* record_;
  std::string prefix_;
};

/// The file under construction.
class Hdf5File {
 public:
  /// Starts an empty file in memory, expected to become about `expected_bytes` large.
  explicit Hdf5File(std::size_t expected_bytes);

  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;

  Hdf5Group& root() { return root_; }

  /// Writes `path`.part and renames it to `path`. Throws FileError; then `path` is as it was before.
  void save(const std::string& path);

  /// After save(): what follows fills the same structure with other values, without HDF5's work of making it. The same
  /// attributes, groups and datasets must come in the same order; one of another name, type or size throws
  /// Hdf5StructureDiffers, and the file is of no further use.
  void refill();

 private:
  Hdf5Handle file_;
  Hdf5Record record_;
  Hdf5Group root_;
};

/// One member of every element of a list, for a dataset: column(model.dofs, &UnknownInfo::owner). Texts are not copied.
template <typename Item, typename Value>
auto column(const std::vector<Item>& items, Value Item::*member) {
  std::vector<std::conditional_t<std::is_same_v<Value, std::string>, std::string_view, Value>> values;
  values.reserve(items.size());
  for (const Item& item : items) values.push_back(item.*member);
  return values;
}

/// Reads the one-dimensional dataset `y` of a matrices file. Throws FileError saying what is wrong with the file.
Eigen::VectorXd read_state(const std::string& path);

}  // namespace mbdae
