// Result files: what is written is read back with plain HDF5 calls; what cannot be written leaves nothing behind.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <hdf5.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>

#include "mbdae/output/hdf5_file.h"
#include "mbdae/output/matrices_file.h"
#include "mbdae/output/motion_file.h"
#include "mbdae/output/provenance.h"

using namespace mbdae;
namespace fs = std::filesystem;

namespace {

/// A directory of its own for every test case.
class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string pattern = (fs::temp_directory_path() / "mbdae_output_XXXXXX").string();
    REQUIRE(::mkdtemp(pattern.data()) != nullptr);
    path_ = pattern;
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    fs::permissions(path_, fs::perms::owner_all, ignored);
    fs::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  std::string file(const std::string& name) const { return (path_ / name).string(); }
  std::size_t count() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(path_), fs::directory_iterator()));
  }

 private:
  fs::path path_;
};

LinearisedModel example_model(int n, int m) {
  LinearisedModel model;
  model.analysis = "linearise";
  model.c = 0.005;
  model.time = 0.25;
  model.J_plus = Eigen::MatrixXd::Random(n, n);
  model.J_minus = Eigen::MatrixXd::Random(n, n);
  model.y = Eigen::VectorXd::Random(n);
  model.ydot = Eigen::VectorXd::Random(n);
  model.residual = Eigen::VectorXd::Random(n);
  model.equilibrium_residual = Eigen::VectorXd::Random(n);
  for (int i = 0; i < n; ++i) model.dofs.push_back({"node " + std::to_string(i) + ".x", "position", "m", 100 + i});
  for (int i = 0; i < m; ++i) model.inputs.push_back({"activation[muscle" + std::to_string(i) + "]", "1"});
  model.g_u = Eigen::MatrixXd::Random(n, m);
  NodeState node;
  node.name = "hand_l";
  node.label = 6;
  node.first = 0;
  node.dofs = 12;
  node.x = {1.0, 2.0, 3.0};
  node.v = {4.0, 5.0, 6.0};
  node.w = {7.0, 8.0, 9.0};
  node.R << 11.0, 12.0, 13.0, 21.0, 22.0, 23.0, 31.0, 32.0, 33.0;
  model.nodes = {node, node};
  model.joints = {{"wrist_l", 40, "cardano hinge", 12, 4}};
  return model;
}

struct OpenFile {
  explicit OpenFile(const std::string& path) : id(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT)) {
    REQUIRE(id >= 0);
  }
  ~OpenFile() { H5Fclose(id); }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  hid_t id;
};

std::vector<hsize_t> shape(const OpenFile& file, const char* name) {
  const hid_t dataset = H5Dopen2(file.id, name, H5P_DEFAULT);
  INFO(name);
  REQUIRE(dataset >= 0);
  const hid_t space = H5Dget_space(dataset);
  std::vector<hsize_t> sizes(static_cast<std::size_t>(H5Sget_simple_extent_ndims(space)));
  if (!sizes.empty()) H5Sget_simple_extent_dims(space, sizes.data(), nullptr);
  H5Sclose(space);
  H5Dclose(dataset);
  return sizes;
}

std::vector<double> numbers(const OpenFile& file, const char* name) {
  std::size_t count = 1;
  for (const hsize_t size : shape(file, name)) count *= size;
  std::vector<double> values(count);
  const hid_t dataset = H5Dopen2(file.id, name, H5P_DEFAULT);
  REQUIRE(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0);
  H5Dclose(dataset);
  return values;
}

std::vector<std::string> texts(const OpenFile& file, const char* name) {
  const std::size_t count = shape(file, name).at(0);
  const hid_t dataset = H5Dopen2(file.id, name, H5P_DEFAULT);
  const hid_t type = H5Dget_type(dataset);
  const std::size_t length = H5Tget_size(type);
  std::string packed(count * length, '?');
  REQUIRE(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, packed.data()) >= 0);
  H5Tclose(type);
  H5Dclose(dataset);
  std::vector<std::string> result;
  for (std::size_t i = 0; i < count; ++i) {
    std::string text = packed.substr(i * length, length);
    result.push_back(text.substr(0, text.find('\0')));
  }
  return result;
}

std::string text_attribute(const OpenFile& file, const char* name) {
  const hid_t attribute = H5Aopen(file.id, name, H5P_DEFAULT);
  REQUIRE(attribute >= 0);
  const hid_t type = H5Aget_type(attribute);
  std::string text(H5Tget_size(type), '?');
  REQUIRE(H5Aread(attribute, type, text.data()) >= 0);
  H5Tclose(type);
  H5Aclose(attribute);
  return text;
}

const Provenance kProvenance{"mbdae 9.9.9", std::string(64, 'a')};

}  // namespace

TEST_CASE("sha256 of the examples of FIPS 180-4") {
  CHECK(sha256_hex("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  CHECK(sha256_hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") ==
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  CHECK(sha256_hex("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST_CASE("a matrices file holds what was given, row-major") {
  const TemporaryDirectory directory;
  const int n = 7, m = 3;
  const LinearisedModel model = example_model(n, m);
  write_matrices_file(directory.file("m.h5"), model, kProvenance);
  CHECK(directory.count() == 1);  // no .part left

  const OpenFile file(directory.file("m.h5"));
  CHECK(text_attribute(file, "filetype") == "pilotgen matrices");
  CHECK(texts(file, "deck_sha256") == std::vector<std::string>{std::string(64, 'a')});
  CHECK(numbers(file, "scalars") == std::vector<double>{0.005, 0.25});
  for (const auto& [name, matrix] : {std::pair<const char*, const Eigen::MatrixXd*>{"J_plus", &model.J_plus},
                                     {"J_minus", &model.J_minus},
                                     {"g_u", &model.g_u}}) {
    INFO(name);
    CHECK(shape(file, name) ==
          std::vector<hsize_t>{static_cast<hsize_t>(matrix->rows()), static_cast<hsize_t>(matrix->cols())});
    const std::vector<double> values = numbers(file, name);
    for (Eigen::Index row = 0; row < matrix->rows(); ++row) {
      for (Eigen::Index col = 0; col < matrix->cols(); ++col) {
        CHECK(values[static_cast<std::size_t>(row * matrix->cols() + col)] == (*matrix)(row, col));
      }
    }
  }
  const std::vector<double> vectors = numbers(file, "vectors");
  for (std::size_t i = 0; i < n; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    CHECK(vectors[4 * i] == model.y(row));
    CHECK(vectors[4 * i + 1] == model.ydot(row));
    CHECK(vectors[4 * i + 2] == model.residual(row));
    CHECK(vectors[4 * i + 3] == model.equilibrium_residual(row));
  }
  const std::string structure = texts(file, "structure").at(0);
  for (const char* part :
       {R"("solver":"mbdae 9.9.9","analysis":"linearise")", R"("node 6.x"],"kind":["position",)",
        R"("owner":[100,101,)", R"("unit":["m",)", R"("activation[muscle2]"],"unit":["1",)",
        R"("nodes":{"name":["hand_l","hand_l"],"label":[6,6],"first":[0,0],"dofs":[12,12]})",
        R"("type":["cardano hinge"],"first":[12],"dofs":[4])", R"("muscles":{"name":[],"label":[]})"}) {
    CHECK_THAT(structure, Catch::Matchers::Contains(part));
  }
  CHECK(structure.size() % 8 == 0);
  CHECK(shape(file, "nodes") == std::vector<hsize_t>{2, 18});
  const std::vector<double> pose{1, 2, 3, 11, 12, 13, 21, 22, 23, 31, 32, 33, 4, 5, 6, 7, 8, 9};
  const std::vector<double> nodes = numbers(file, "nodes");
  CHECK(std::vector<double>(nodes.begin(), nodes.begin() + 18) == pose);
  CHECK(std::vector<double>(nodes.begin() + 18, nodes.end()) == pose);
  CHECK(shape(file, "muscles") == std::vector<hsize_t>{0, 5});
  CHECK(shape(file, "checksum") == std::vector<hsize_t>{8, 2});

  CHECK(read_state(directory.file("m.h5")) == model.y);
}

TEST_CASE("a model without unknowns or inputs is still a file") {
  const TemporaryDirectory directory;
  LinearisedModel model;
  model.analysis = "static";
  write_matrices_file(directory.file("empty.h5"), model, kProvenance);
  const OpenFile file(directory.file("empty.h5"));
  CHECK(shape(file, "J_plus") == std::vector<hsize_t>{0, 0});
  CHECK(shape(file, "nodes") == std::vector<hsize_t>{0, 18});
}

TEST_CASE("a file of the structure of the last one is the file made anew") {
  const TemporaryDirectory directory;
  const auto written = [&](const LinearisedModel& model, const Provenance& provenance) {
    write_matrices_file(directory.file("m.h5"), model, provenance);
    std::ifstream in(directory.file("m.h5"), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const LinearisedModel one = example_model(7, 3), other = example_model(7, 3), larger = example_model(8, 2);
  LinearisedModel renamed = one;
  renamed.dofs[3].name = "a \"quoted\\name\"";
  const Provenance another{"mbdae 9.9.9", std::string(64, 'b')}, none{"mbdae 9.9.9", "-"};
  const std::vector<std::pair<const LinearisedModel*, const Provenance*>> files{
      {&one, &kProvenance}, {&other, &another}, {&renamed, &kProvenance}, {&one, &none}, {&other, &kProvenance}};
  for (const auto& [model, provenance] : files) {
    written(larger, kProvenance);
    const std::string anew = written(*model, *provenance);
    written(one, *provenance);
    CHECK((written(*model, *provenance) == anew));
  }
}

TEST_CASE("the places told are where HDF5 finds the datasets") {
  const TemporaryDirectory directory;
  const LinearisedModel model = example_model(7, 3);
  const std::vector<DatasetPlace> places = write_matrices_file(directory.file("m.h5"), model, kProvenance);
  const OpenFile file(directory.file("m.h5"));
  CHECK(places.size() == 10);
  for (const DatasetPlace& place : places) {
    INFO(place.name);
    const hid_t dataset = H5Dopen2(file.id, place.name, H5P_DEFAULT);
    REQUIRE(dataset >= 0);
    if (place.dimensions[0] > 0) CHECK(H5Dget_offset(dataset) == place.offset);
    CHECK(place.offset % 8 == 0);
    if (place.dimensions.size() == 2) {
      CHECK(shape(file, place.name) == std::vector<hsize_t>{place.dimensions[0], place.dimensions[1]});
    }
    H5Dclose(dataset);
  }
}

TEST_CASE("a motion file holds time, channels and data") {
  const TemporaryDirectory directory;
  Motion motion;
  motion.time = {0.0, 0.1, 0.2, 0.3};
  motion.channels = {{"lever.gz", "rad"}, {"muscle[delt1_l].force", "N"}};
  motion.data.resize(4, 2);
  motion.data << 1, 2, 3, 4, 5, 6, 7, 8;
  write_motion_file(directory.file("motion.h5"), motion, {"ms", 1e-8, 1e-10}, kProvenance);
  const OpenFile file(directory.file("motion.h5"));
  CHECK(text_attribute(file, "filetype") == "pilotgen motion");
  CHECK(text_attribute(file, "integrator") == "ms");
  CHECK(numbers(file, "time") == motion.time);
  CHECK(shape(file, "data") == std::vector<hsize_t>{4, 2});
  CHECK(numbers(file, "data") == std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8});
  CHECK(texts(file, "channels/name") == std::vector<std::string>{"lever.gz", "muscle[delt1_l].force"});
  CHECK(texts(file, "channels/unit") == std::vector<std::string>{"rad", "N"});
}

TEST_CASE("a file that cannot be written leaves nothing behind and says why") {
  const TemporaryDirectory directory;
  const LinearisedModel model = example_model(40, 2);

  SECTION("missing directory") {
    CHECK_THROWS_WITH(write_matrices_file(directory.file("no/m.h5"), model, kProvenance),
                      Catch::Matchers::Contains("no/m.h5") && Catch::Matchers::Contains("No such file or directory"));
  }
  SECTION("the disk is full: the old file survives") {
    { std::ofstream(directory.file("m.h5")) << "old"; }
    fs::create_symlink("/dev/full", directory.file("m.h5.part"));
    CHECK_THROWS_WITH(write_matrices_file(directory.file("m.h5"), model, kProvenance),
                      Catch::Matchers::Contains("something else than a regular file has that name"));
    CHECK(fs::is_symlink(directory.file("m.h5.part")));  // neither followed nor removed
    std::ifstream old(directory.file("m.h5"));
    std::string text;
    old >> text;
    CHECK(text == "old");
  }
  SECTION("the target is a directory") {
    fs::create_directory(directory.file("m.h5"));
    CHECK_THROWS_AS(write_matrices_file(directory.file("m.h5"), model, kProvenance), FileError);
    CHECK(directory.count() == 1);
  }
}

TEST_CASE("a state file that is none is refused in words") {
  const TemporaryDirectory directory;
  CHECK_THROWS_WITH(read_state(directory.file("absent.h5")), Catch::Matchers::Contains("No such file"));
  { std::ofstream(directory.file("text.h5")) << "not HDF5"; }
  CHECK_THROWS_WITH(read_state(directory.file("text.h5")), Catch::Matchers::Contains("not an HDF5 file"));
  {
    Hdf5File file(0);
    file.root().dataset("z", std::vector<double>{1.0});
    file.save(directory.file("nodofs.h5"));
  }
  CHECK_THROWS_WITH(read_state(directory.file("nodofs.h5")), Catch::Matchers::Contains("no dataset 'vectors'"));
  {
    Hdf5File file(0);
    file.root().dataset("vectors", std::vector<double>{1.0});
    file.save(directory.file("list.h5"));
  }
  CHECK_THROWS_WITH(read_state(directory.file("list.h5")), Catch::Matchers::Contains("not a matrix"));
}

TEST_CASE("time to write a matrices file", "[!benchmark]") {
  const TemporaryDirectory directory;
  const LinearisedModel model = example_model(100, 26);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 100; ++i) write_matrices_file(directory.file("m.h5"), model, kProvenance);
  const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - start;
  WARN("matrices file with 100 unknowns: " << elapsed.count() / 100 << " ms");
}
