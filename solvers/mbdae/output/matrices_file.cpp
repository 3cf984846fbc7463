// In the order of docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/matrices_file.h"

#include <memory>
#include <utility>

namespace mbdae {

namespace {

constexpr std::array<int, 2> kVersion{1, 0};  // of the format; bump together with the page

/// A vector or matrix member of every node, row-major, with its dimensions.
template <typename Value>
void node_dataset(Hdf5Group& group, const std::string& name, const std::vector<NodeState>& nodes,
                  Value NodeState::*member) {
  std::vector<double> values;
  std::vector<std::uint64_t> dimensions{nodes.size(), 3};
  if (Value::ColsAtCompileTime == 3) dimensions.push_back(3);
  values.reserve(nodes.size() * Value::SizeAtCompileTime);
  for (const NodeState& node : nodes) {
    const Value& value = node.*member;
    for (Eigen::Index row = 0; row < value.rows(); ++row) {
      for (Eigen::Index col = 0; col < value.cols(); ++col) values.push_back(value(row, col));
    }
  }
  group.dataset(name, values, dimensions);
}

void fill(Hdf5File& file, const LinearisedModel& model, const Provenance& provenance) {
  Hdf5Group& root = file.root();
  write_header(root, "pilotgen matrices", kVersion, provenance);
  root.attribute("analysis", model.analysis);
  root.dataset("c", model.c);
  root.dataset("time", model.time);
  root.dataset("J_plus", model.J_plus);
  root.dataset("J_minus", model.J_minus);
  root.dataset("y", model.y);
  root.dataset("ydot", model.ydot);
  root.dataset("residual", model.residual);
  root.dataset("equilibrium_residual", model.equilibrium_residual);

  Hdf5Group dofs = root.group("dofs");
  dofs.dataset("name", column(model.dofs, &UnknownInfo::name));
  dofs.dataset("kind", column(model.dofs, &UnknownInfo::kind));
  dofs.dataset("owner", column(model.dofs, &UnknownInfo::owner));
  dofs.dataset("unit", column(model.dofs, &UnknownInfo::unit));

  Hdf5Group inputs = root.group("inputs");
  inputs.dataset("name", column(model.inputs, &InputInfo::name));
  inputs.dataset("unit", column(model.inputs, &InputInfo::unit));
  inputs.dataset("g_u", model.g_u);

  Hdf5Group nodes = root.group("nodes");
  nodes.dataset("name", column(model.nodes, &NodeState::name));
  nodes.dataset("label", column(model.nodes, &NodeState::label));
  nodes.dataset("first", column(model.nodes, &NodeState::first));
  nodes.dataset("dofs", column(model.nodes, &NodeState::dofs));
  node_dataset(nodes, "position", model.nodes, &NodeState::x);
  node_dataset(nodes, "orientation", model.nodes, &NodeState::R);
  node_dataset(nodes, "velocity", model.nodes, &NodeState::v);
  node_dataset(nodes, "angular_velocity", model.nodes, &NodeState::w);

  Hdf5Group joints = root.group("joints");
  joints.dataset("name", column(model.joints, &JointInfo::name));
  joints.dataset("label", column(model.joints, &JointInfo::label));
  joints.dataset("type", column(model.joints, &JointInfo::type));
  joints.dataset("first", column(model.joints, &JointInfo::first));
  joints.dataset("dofs", column(model.joints, &JointInfo::dofs));

  Hdf5Group muscles = root.group("muscles");
  muscles.dataset("name", column(model.muscles, &MuscleState::name));
  muscles.dataset("label", column(model.muscles, &MuscleState::label));
  muscles.dataset("length", column(model.muscles, &MuscleState::length));
  muscles.dataset("x", column(model.muscles, &MuscleState::x));
  muscles.dataset("v", column(model.muscles, &MuscleState::v));
  muscles.dataset("activation", column(model.muscles, &MuscleState::activation));
  muscles.dataset("force", column(model.muscles, &MuscleState::force));
}

}  // namespace

void write_matrices_file(const std::string& path, const LinearisedModel& model, const Provenance& provenance) {
  // A serving process writes thousands of files of one structure: the last one is kept and filled again.
  static std::unique_ptr<Hdf5File> last;
  if (last) {
    try {
      last->refill();
      fill(*last, model, provenance);
      last->save(path);
      return;
    } catch (const Hdf5StructureDiffers&) {
      last.reset();
    } catch (...) {
      last.reset();
      throw;
    }
  }
  const auto n = static_cast<std::size_t>(model.y.size());
  // Matrices and vectors exactly; 256 bytes per unknown and 16 kB cover the strings and HDF5's own records.
  const std::size_t expected = 8 * n * (2 * n + model.inputs.size() + 4) + 256 * n + 16384;
  auto file = std::make_unique<Hdf5File>(expected);
  fill(*file, model, provenance);
  file->save(path);
  last = std::move(file);
}

}  // namespace mbdae
