// In the order of docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/matrices_file.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace mbdae {

namespace {

constexpr std::array<int, 2> kVersion{2, 0};  // of the format; bump together with the page

/// A text in JSON.
std::string quoted(std::string_view text) {
  std::string result = "\"";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20) {
      constexpr char kDigits[] = "0123456789abcdef";
      result += std::string("\\u00") + kDigits[c >> 4] + kDigits[c & 15];
      continue;
    }
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + "\"";
}

std::string list(const std::vector<std::string_view>& texts) {
  std::string text = "[";
  for (const std::string_view item : texts) {
    if (text.size() > 1) text += ',';
    text += quoted(item);
  }
  return text + "]";
}

std::string list(const std::vector<int>& values) {
  std::string text = "[";
  for (const int value : values) {
    if (text.size() > 1) text += ',';
    text += std::to_string(value);
  }
  return text + "]";
}

/// Names, labels and places of everything, as JSON: what two decks of one structure have in common.
std::string structure_of(const LinearisedModel& model, const std::string& solver) {
  return "{\"solver\":" + quoted(solver) + ",\"analysis\":" + quoted(model.analysis) +
         ",\"dofs\":{\"name\":" + list(column(model.dofs, &UnknownInfo::name)) +
         ",\"kind\":" + list(column(model.dofs, &UnknownInfo::kind)) +
         ",\"owner\":" + list(column(model.dofs, &UnknownInfo::owner)) +
         ",\"unit\":" + list(column(model.dofs, &UnknownInfo::unit)) +
         "},\"inputs\":{\"name\":" + list(column(model.inputs, &InputInfo::name)) +
         ",\"unit\":" + list(column(model.inputs, &InputInfo::unit)) +
         "},\"nodes\":{\"name\":" + list(column(model.nodes, &NodeState::name)) +
         ",\"label\":" + list(column(model.nodes, &NodeState::label)) +
         ",\"first\":" + list(column(model.nodes, &NodeState::first)) +
         ",\"dofs\":" + list(column(model.nodes, &NodeState::dofs)) +
         "},\"joints\":{\"name\":" + list(column(model.joints, &JointInfo::name)) +
         ",\"label\":" + list(column(model.joints, &JointInfo::label)) +
         ",\"type\":" + list(column(model.joints, &JointInfo::type)) +
         ",\"first\":" + list(column(model.joints, &JointInfo::first)) +
         ",\"dofs\":" + list(column(model.joints, &JointInfo::dofs)) +
         "},\"muscles\":{\"name\":" + list(column(model.muscles, &MuscleState::name)) +
         ",\"label\":" + list(column(model.muscles, &MuscleState::label)) + "}}";
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// One row per node: position, orientation (row-major), velocity, angular velocity.
RowMajor poses(const std::vector<NodeState>& nodes) {
  RowMajor rows(nodes.size(), 18);
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const NodeState& node = nodes[k];
    rows.row(static_cast<Eigen::Index>(k)) << node.x.transpose(), node.R.row(0), node.R.row(1), node.R.row(2),
        node.v.transpose(), node.w.transpose();
  }
  return rows;
}

/// One row per muscle: length, x, v, activation, force.
RowMajor muscle_states(const std::vector<MuscleState>& muscles) {
  RowMajor rows(muscles.size(), 5);
  for (std::size_t k = 0; k < muscles.size(); ++k) {
    const MuscleState& m = muscles[k];
    rows.row(static_cast<Eigen::Index>(k)) << m.length, m.x, m.v, m.activation, m.force;
  }
  return rows;
}

/// The datasets of numbers, in the order in which `checksum` has its rows.
constexpr std::array<const char*, 7> kNumbers{"scalars", "J_plus", "J_minus", "g_u", "vectors", "nodes", "muscles"};

std::array<RowMajor, kNumbers.size()> numbers_of(const LinearisedModel& model) {
  RowMajor scalars(1, 2), vectors(model.y.size(), 4);
  scalars << model.c, model.time;
  if (model.y.size() > 0) vectors << model.y, model.ydot, model.residual, model.equilibrium_residual;
  return {scalars, model.J_plus, model.J_minus, model.g_u, vectors, poses(model.nodes), muscle_states(model.muscles)};
}

/// Sums of 64-bit words and of words times their place, counted from 1, both modulo 2^64 (after Fletcher): a flipped
/// bit changes the first, two words that change places the second.
std::array<std::uint64_t, 2> checksum(const char* bytes, std::size_t count) {
  std::uint64_t sum = 0, weighted = 0, word = 0;
  for (std::size_t i = 0; i < count; ++i) {
    std::memcpy(&word, bytes + 8 * i, 8);
    sum += word;
    weighted += (i + 1) * word;
  }
  return {sum, weighted};
}

/// A file of one structure: every such file has these bytes but for numbers, deck's hash and checksums.
struct Template {
  std::string structure;
  std::array<std::array<Eigen::Index, 2>, kNumbers.size()> shapes{};
  std::vector<char> bytes;
  std::array<std::size_t, kNumbers.size()> numbers_at{};
  std::size_t deck_hash_bytes = 0, hash_at = 0, checksum_at = 0;
  std::vector<DatasetPlace> places;
};

Template make_template(const std::string& structure, const std::string& deck_sha256,
                       const std::array<RowMajor, kNumbers.size()>& numbers) {
  std::size_t expected = 2 * structure.size() + 16384;
  for (const RowMajor& matrix : numbers) expected += 8 * static_cast<std::size_t>(matrix.size());
  Hdf5File file(expected);
  Hdf5Group& root = file.root();
  root.attribute("filetype", "pilotgen matrices");
  root.attribute("version", kVersion);
  root.dataset("deck_sha256", std::vector<std::string_view>{deck_sha256});
  const std::string padded = structure + std::string((8 - structure.size() % 8) % 8, ' ');
  root.dataset("structure", std::vector<std::string_view>{padded});
  std::array<std::uint64_t, 2 * (kNumbers.size() + 1)> sums{};
  const std::array<std::uint64_t, 2> of_structure = checksum(padded.data(), padded.size() / 8);
  std::copy(of_structure.begin(), of_structure.end(), sums.begin());
  root.dataset("checksum", sums, std::array<std::uint64_t, 2>{kNumbers.size() + 1, 2});
  Template made{structure, {}, {}, {}, deck_sha256.size(), 0, 0, {}};
  for (std::size_t i = 0; i < kNumbers.size(); ++i) {
    made.shapes[i] = {numbers[i].rows(), numbers[i].cols()};
    const std::array<std::uint64_t, 2> dimensions{static_cast<std::uint64_t>(numbers[i].rows()),
                                                  static_cast<std::uint64_t>(numbers[i].cols())};
    root.dataset(kNumbers[i], std::span(numbers[i].data(), static_cast<std::size_t>(numbers[i].size())), dimensions);
  }
  const std::span<const char> image = file.image();
  made.bytes.assign(image.begin(), image.end());
  made.hash_at = file.offset("deck_sha256");
  made.checksum_at = file.offset("checksum");
  made.places = {{"deck_sha256", made.hash_at, {deck_sha256.size()}},
                 {"structure", file.offset("structure"), {padded.size()}},
                 {"checksum", made.checksum_at, {kNumbers.size() + 1, 2}}};
  for (std::size_t i = 0; i < kNumbers.size(); ++i) {
    const auto [rows, columns] = made.shapes[i];
    if (rows * columns > 0) made.numbers_at[i] = file.offset(kNumbers[i]);
    made.places.push_back(
        {kNumbers[i], made.numbers_at[i], {static_cast<std::uint64_t>(rows), static_cast<std::uint64_t>(columns)}});
  }
  return made;
}

bool fits(const Template& known, const std::string& structure, const std::string& deck_sha256,
          const std::array<RowMajor, kNumbers.size()>& numbers) {
  for (std::size_t i = 0; i < kNumbers.size(); ++i) {
    if (known.shapes[i] != std::array{numbers[i].rows(), numbers[i].cols()}) return false;
  }
  return known.deck_hash_bytes == deck_sha256.size() && known.structure == structure;
}

}  // namespace

std::vector<DatasetPlace> write_matrices_file(const std::string& path, const LinearisedModel& model,
                                              const Provenance& provenance) {
  const std::string structure = structure_of(model, provenance.solver);
  const std::array<RowMajor, kNumbers.size()> numbers = numbers_of(model);
  // A serving process writes thousands of files of a few structures. HDF5 takes 0.4 ms to make one, filling it 0.05.
  constexpr std::size_t kMostKnown = 4;
  static std::vector<Template> known;  // the last used first
  const auto same = std::ranges::find_if(
      known, [&](const Template& one) { return fits(one, structure, provenance.deck_sha256, numbers); });
  if (same != known.end()) {
    std::rotate(known.begin(), same, same + 1);
  } else {
    if (known.size() == kMostKnown) known.pop_back();
    known.insert(known.begin(), make_template(structure, provenance.deck_sha256, numbers));
  }
  Template& file = known.front();
  char* const image = file.bytes.data();
  std::memcpy(image + file.hash_at, provenance.deck_sha256.data(), provenance.deck_sha256.size());
  for (std::size_t i = 0; i < kNumbers.size(); ++i) {
    const auto count = static_cast<std::size_t>(numbers[i].size());
    if (count == 0) continue;
    std::memcpy(image + file.numbers_at[i], numbers[i].data(), 8 * count);
    const std::array<std::uint64_t, 2> sums = checksum(image + file.numbers_at[i], count);
    std::memcpy(image + file.checksum_at + sizeof sums * (i + 1), sums.data(), sizeof sums);
  }
  write_file(path, file.bytes);
  return file.places;
}

}  // namespace mbdae
