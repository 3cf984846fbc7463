// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/hdf5_file.h"

#include <fcntl.h>
#include <hdf5.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <utility>

namespace mbdae {

namespace {

static_assert(sizeof(hid_t) == sizeof(std::int64_t));
static_assert(sizeof(hsize_t) == sizeof(std::uint64_t));
// Values are in memory as they are in the file.
static_assert(std::endian::native == std::endian::little && sizeof(int) == 4);

/// HDF5 prints its error stack by default; the exceptions of this file say what a person needs.
void silence_hdf5() {
  static const bool once = [] {
    H5open();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    return true;
  }();
  (void)once;
}

Hdf5Handle dataspace(std::span<const std::uint64_t> dimensions) {
  if (dimensions.empty()) return {H5Screate(H5S_SCALAR), H5Sclose, "scalar dataspace"};
  std::array<hsize_t, 4> sizes{};
  if (dimensions.size() > sizes.size()) throw FileError("HDF5: too many dimensions");
  std::copy(dimensions.begin(), dimensions.end(), sizes.begin());
  return {H5Screate_simple(static_cast<int>(dimensions.size()), sizes.data(), nullptr), H5Sclose, "dataspace"};
}

Hdf5Handle string_type(std::size_t length) {
  Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose, "string type");
  H5Tset_size(type.id(), std::max<std::size_t>(length, 1));
  H5Tset_strpad(type.id(), H5T_STR_NULLPAD);
  H5Tset_cset(type.id(), H5T_CSET_UTF8);
  return type;
}

/// Creation properties without times: a file depends on what is in it, not on when it was written.
Hdf5Handle timeless(std::int64_t property_class) {
  Hdf5Handle properties(H5Pcreate(property_class), H5Pclose, "creation properties");
  H5Pset_obj_track_times(properties.id(), false);
  return properties;
}

struct PackedTexts {
  std::size_t length;  ///< of every text
  std::string bytes;
};

PackedTexts pack_texts(const std::vector<std::string_view>& texts) {
  std::size_t length = 1;
  for (const std::string_view text : texts) length = std::max(length, text.size());
  std::string packed(length * texts.size(), '\0');
  for (std::size_t i = 0; i < texts.size(); ++i) std::copy(texts[i].begin(), texts[i].end(), &packed[i * length]);
  return {length, std::move(packed)};
}

Hdf5Handle create_in_memory(std::size_t expected_bytes) {
  silence_hdf5();
  const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "file access");
  H5Pset_alignment(access.id(), 1, 8);
  // One growth step for the usual file; no backing store: save() puts the image on disk.
  H5Pset_fapl_core(access.id(), std::max<std::size_t>(expected_bytes, 65536), false);
  // The 1.8 format: compact as the latest one, but without its "open for writing" mark, which stays in an image.
  H5Pset_libver_bounds(access.id(), H5F_LIBVER_V18, H5F_LIBVER_V18);
  const Hdf5Handle creation = timeless(H5P_FILE_CREATE);
  static int count = 0;  // HDF5 opens no two files of one name at a time
  const std::string name = "in memory " + std::to_string(++count);
  return {H5Fcreate(name.c_str(), H5F_ACC_TRUNC, creation.id(), access.id()), H5Fclose, "file in memory"};
}

Hdf5Handle open_root(const Hdf5Handle& file) { return {H5Gopen2(file.id(), "/", H5P_DEFAULT), H5Gclose, "root group"}; }

/// The in-memory driver's own buffer: the whole file. (H5Fget_file_image of HDF5 1.10 resets a byte that the
/// superblock's checksum covers, without renewing the checksum.)
std::span<char> image_of(const Hdf5Handle& file) {
  void* buffer = nullptr;
  if (H5Fflush(file.id(), H5F_SCOPE_LOCAL) < 0 || H5Fget_vfd_handle(file.id(), H5P_DEFAULT, &buffer) < 0) {
    throw FileError("HDF5: no image of the file in memory");
  }
  // The buffer is longer than what is in use, and H5Fget_filesize tells its length.
  const ssize_t size = H5Fget_file_image(file.id(), nullptr, 0);
  if (size < 0) throw FileError("HDF5: no size of the file in memory");
  return {*static_cast<char* const*>(buffer), static_cast<std::size_t>(size)};
}

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return fd_; }
  /// Closes now; false on error (a full disk may show only here).
  bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

[[noreturn]] void fail_to_write(const std::string& path, int error) {
  throw FileError("cannot write '" + path + "': " + std::strerror(error));
}

}  // namespace

// ---- handles -----------------------------------------------------------------------------------------------------

Hdf5Handle::Hdf5Handle(std::int64_t id, Closer closer, const char* what) : id_(id), closer_(closer) {
  if (id_ < 0) throw FileError(std::string("HDF5: cannot create or open ") + what);
}

Hdf5Handle::~Hdf5Handle() {
  if (id_ >= 0) closer_(id_);
}

Hdf5Handle::Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}

// ---- groups ------------------------------------------------------------------------------------------------------

Hdf5Group Hdf5Group::group(const std::string& name) {
  const Hdf5Handle creation = timeless(H5P_GROUP_CREATE);
  return Hdf5Group(
      {H5Gcreate2(handle_.id(), name.c_str(), H5P_DEFAULT, creation.id(), H5P_DEFAULT), H5Gclose, name.c_str()});
}

void Hdf5Group::write_attribute(const std::string& name, std::int64_t type, std::int64_t memory_type, const void* data,
                                std::span<const std::uint64_t> dimensions) {
  const Hdf5Handle space = dataspace(dimensions);
  const Hdf5Handle attribute(H5Acreate2(handle_.id(), name.c_str(), type, space.id(), H5P_DEFAULT, H5P_DEFAULT),
                             H5Aclose, name.c_str());
  if (H5Awrite(attribute.id(), memory_type, data) < 0) throw FileError("HDF5: cannot write attribute " + name);
}

void Hdf5Group::attribute(const std::string& name, const std::string& text) {
  const Hdf5Handle type = string_type(text.size());  // one byte at least, which c_str() has
  write_attribute(name, type.id(), type.id(), text.c_str(), {});
}

void Hdf5Group::attribute(const std::string& name, const std::array<int, 2>& values) {
  const std::array<std::uint64_t, 1> dimensions{2};
  write_attribute(name, H5T_STD_I32LE, H5T_NATIVE_INT, values.data(), dimensions);
}

void Hdf5Group::attribute(const std::string& name, double value) {
  write_attribute(name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value, {});
}

void Hdf5Group::write(const std::string& name, std::int64_t type, const void* data,
                      std::span<const std::uint64_t> dimensions) {
  const Hdf5Handle space = dataspace(dimensions);
  const Hdf5Handle creation = timeless(H5P_DATASET_CREATE);
  const Hdf5Handle dataset(
      H5Dcreate2(handle_.id(), name.c_str(), type, space.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT), H5Dclose,
      name.c_str());
  if (std::ranges::find(dimensions, 0u) != dimensions.end()) return;  // nothing to write, and `data` may be null
  if (H5Dwrite(dataset.id(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0) {
    throw FileError("HDF5: cannot write dataset " + name);
  }
}

void Hdf5Group::dataset(const std::string& name, std::span<const double> values,
                        std::span<const std::uint64_t> dimensions) {
  std::uint64_t count = 1;
  for (const std::uint64_t size : dimensions) count *= size;
  if (count != values.size()) throw FileError("HDF5: dimensions of dataset " + name + " do not fit its values");
  write(name, H5T_IEEE_F64LE, values.data(), dimensions);
}

void Hdf5Group::dataset(const std::string& name, std::span<const std::uint64_t> values,
                        std::span<const std::uint64_t> dimensions) {
  write(name, H5T_STD_U64LE, values.data(), dimensions);
}

void Hdf5Group::dataset(const std::string& name, const std::vector<double>& values) {
  const std::array<std::uint64_t, 1> dimensions{values.size()};
  write(name, H5T_IEEE_F64LE, values.data(), dimensions);
}

void Hdf5Group::dataset(const std::string& name, const std::vector<std::string_view>& texts) {
  const PackedTexts packed = pack_texts(texts);
  const Hdf5Handle type = string_type(packed.length);
  const std::array<std::uint64_t, 1> dimensions{texts.size()};
  write(name, type.id(), packed.bytes.data(), dimensions);
}

void Hdf5Group::dataset(const std::string& name, const Eigen::MatrixXd& matrix) {
  const std::array<std::uint64_t, 2> dimensions{static_cast<std::uint64_t>(matrix.rows()),
                                                static_cast<std::uint64_t>(matrix.cols())};
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = matrix;
  write(name, H5T_IEEE_F64LE, rows.data(), dimensions);
}

// ---- the file ----------------------------------------------------------------------------------------------------

Hdf5File::Hdf5File(std::size_t expected_bytes) : file_(create_in_memory(expected_bytes)), root_(open_root(file_)) {}

std::span<const char> Hdf5File::image() {
  image_of(file_);  // the first flush of a new file gives back unused space, the second one notes its end
  return image_of(file_);
}

std::size_t Hdf5File::offset(const std::string& dataset) {
  const Hdf5Handle handle(H5Dopen2(file_.id(), dataset.c_str(), H5P_DEFAULT), H5Dclose, dataset.c_str());
  const haddr_t place = H5Dget_offset(handle.id());
  if (place == HADDR_UNDEF || place % 8 != 0) throw FileError("HDF5: dataset " + dataset + " is not in one piece");
  return place;
}

void Hdf5File::save(const std::string& path) { write_file(path, image()); }

void write_file(const std::string& path, std::span<const char> image) {
  const std::string part = path + ".part";
  // Whatever stands there is ours from a run that was stopped, or a trap: it is not followed, and not written into.
  struct stat status {};
  if (::lstat(part.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    throw FileError("cannot write '" + part + "': something else than a regular file has that name");
  }
  Descriptor file(::open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666));
  if (file.get() < 0) fail_to_write(path, errno);
  std::size_t written = 0;
  while (written < image.size()) {
    const ssize_t count = ::write(file.get(), image.data() + written, image.size() - written);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      const int error = count == 0 ? ENOSPC : errno;
      ::unlink(part.c_str());
      fail_to_write(path, error);
    }
    written += static_cast<std::size_t>(count);
  }
  if (!file.close() || ::rename(part.c_str(), path.c_str()) != 0) {
    const int error = errno;
    ::unlink(part.c_str());
    fail_to_write(path, error);
  }
}

// ---- reading -----------------------------------------------------------------------------------------------------

Eigen::VectorXd read_state(const std::string& path) {
  silence_hdf5();
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) throw FileError("cannot read '" + path + "': " + std::strerror(errno));
  const std::int64_t id = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (id < 0) throw FileError("'" + path + "' is not an HDF5 file; a matrices file was expected");
  const Hdf5Handle file(id, H5Fclose, path.c_str());
  const std::int64_t dataset_id = H5Dopen2(file.id(), "vectors", H5P_DEFAULT);
  if (dataset_id < 0) throw FileError("'" + path + "' has no dataset 'vectors'; a matrices file was expected");
  const Hdf5Handle dataset(dataset_id, H5Dclose, "vectors");
  const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose, "dataspace of vectors");
  std::array<hsize_t, 2> sizes{};
  if (H5Sget_simple_extent_ndims(space.id()) != 2 || H5Sget_simple_extent_dims(space.id(), sizes.data(), nullptr) < 0 ||
      sizes[1] == 0) {
    throw FileError("'" + path + "': dataset 'vectors' is not a matrix");
  }
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> vectors(static_cast<Eigen::Index>(sizes[0]),
                                                                                 static_cast<Eigen::Index>(sizes[1]));
  if (H5Dread(dataset.id(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, vectors.data()) < 0) {
    throw FileError("'" + path + "': dataset 'vectors' cannot be read as numbers: it is of another kind or damaged");
  }
  Eigen::VectorXd y = vectors.col(0);
  if (!y.allFinite()) throw FileError("'" + path + "': the state holds a value that is not finite");
  return y;
}

}  // namespace mbdae
