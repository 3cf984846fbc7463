// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/recorder.h"

#include <algorithm>
#include <array>

#include "mbdae/dae/analyses.h"

namespace mbdae {

namespace {

constexpr std::array<std::pair<const char*, const char*>, 12> kNodeChannels{{{"x", "m"},
                                                                             {"y", "m"},
                                                                             {"z", "m"},
                                                                             {"gx", "rad"},
                                                                             {"gy", "rad"},
                                                                             {"gz", "rad"},
                                                                             {"vx", "m/s"},
                                                                             {"vy", "m/s"},
                                                                             {"vz", "m/s"},
                                                                             {"wx", "rad/s"},
                                                                             {"wy", "rad/s"},
                                                                             {"wz", "rad/s"}}};

bool is_momentum(const Model& model, int k) {
  const std::string kind = model.unknown_kind(k);
  return kind == "momentum" || kind == "momenta_moment";
}

std::vector<InputInfo> all_channels(const Model& model) {
  std::vector<InputInfo> out;
  for (const NodeData& node : model.deck().nodes) {
    for (const auto& [suffix, unit] : kNodeChannels) out.push_back({node.id.name + "." + suffix, unit});
  }
  for (int k = model.own_start(); k < model.size(); ++k) {
    out.push_back({model.unknown_name(k), model.unknown_unit(k)});
  }
  for (const MuscleEntry& entry : model.muscles()) {
    const std::string name = "muscle[" + entry.data->id.name + "]";
    out.push_back({name + ".length", "m"});
    out.push_back({name + ".force", "N"});
    out.push_back({name + ".activation", "-"});
  }
  for (int k = 0; k < model.scalar_start(); ++k) {
    if (is_momentum(model, k)) out.push_back({model.unknown_name(k), model.unknown_unit(k)});
  }
  return out;
}

}  // namespace

MotionRecorder::MotionRecorder(const Model& model, const std::vector<std::string>& wanted) : model_(model) {
  for (int k = 0; k < model.scalar_start(); ++k) {
    if (is_momentum(model, k)) momenta_.push_back(k);
  }
  const std::vector<InputInfo> all = all_channels(model);
  if (wanted.empty()) {
    motion_.channels = all;
    for (std::size_t i = 0; i < all.size(); ++i) columns_.push_back(i);
    return;
  }
  for (const std::string& name : wanted) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const InputInfo& info) { return info.name == name; });
    if (found == all.end()) {
      throw ModelError("there is no output channel '" + name + "'; channels look like '" + all.front().name +
                       "', JOINT.reaction[1], muscle[NAME].force");
    }
    motion_.channels.push_back(*found);
    columns_.push_back(static_cast<std::size_t>(found - all.begin()));
  }
}

void MotionRecorder::record(const State& state, double time) {
  row_.clear();
  const auto push = [&](const Vec3& v) { row_.insert(row_.end(), v.data(), v.data() + 3); };
  for (const NodeMotion& node : state.nodes) {
    push(node.x);
    push(rotation_log(node.R));
    push(node.v);
    push(node.w);
  }
  for (int k = model_.own_start(); k < model_.size(); ++k) row_.push_back(state.y(k));
  for (const MuscleEntry& entry : model_.muscles()) {
    const MuscleValue value = entry.muscle->value(state);
    row_.push_back(entry.muscle->length(state));
    row_.push_back(value.force);
    row_.push_back(value.activation);
  }
  for (const int k : momenta_) row_.push_back(state.y(k));
  motion_.time.push_back(time);
  for (const std::size_t column : columns_) values_.push_back(row_[column]);
}

Motion MotionRecorder::take() {
  motion_.data = Eigen::Map<const decltype(motion_.data)>(
      values_.data(), static_cast<Eigen::Index>(motion_.time.size()), static_cast<Eigen::Index>(columns_.size()));
  return std::move(motion_);
}

}  // namespace mbdae
