// What the card readers share: the input, the deck being filled, and everything that has been named so far.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "mbdae/deck/arguments.h"
#include "mbdae/deck/deck.h"
#include "mbdae/drive/file_drive.h"

namespace mbdae::reading {

/// A moving frame: origin, axes, velocity and angular velocity in global components.
struct Frame {
  Vec3 x = Vec3::Zero();
  Mat3 R = Mat3::Identity();
  Vec3 v = Vec3::Zero();
  Vec3 w = Vec3::Zero();
};

inline bool same_place(const SourcePosition& one, const SourcePosition& other) {
  return one.file == other.file && one.line == other.line && one.column == other.column;
}

/// Things defined by cards `...: label, ...`. A label whose card had an error stays known as broken, so that its
/// users say nothing more.
template <class T>
class Registry {
 public:
  explicit Registry(const char* kind) : kind_(kind) {}

  /// A new label, which counts as broken until `define`. An error if it has been used before.
  void announce(Input& input, const Label& label) {
    if (broken_.count(label.value) != 0) throw Reported{};
    const auto found = items_.find(label.value);
    if (found != items_.end()) {
      input.fail(label.where, std::string(kind_) + " " + std::to_string(label.value) + " is defined already (line " +
                                  std::to_string(found->second.first.line) + ")");
    }
    broken_.insert(label.value);
    open_ = label.value;
    open_card_ = input.card_position();
  }
  void define(const Label& label, T item) {
    broken_.erase(label.value);
    items_.emplace(label.value, std::make_pair(label.where, std::move(item)));
  }
  /// Takes an announced label back.
  void forget(const Label& label) { broken_.erase(label.value); }
  /// Null if nothing has that label; throws Reported if its card had an error.
  const T* find(std::uint32_t label) const {
    if (broken_.count(label) != 0) throw Reported{};
    const auto found = items_.find(label);
    return found == items_.end() ? nullptr : &found->second.second;
  }
  const T& get(Input& input, const Label& label) const {
    if (open_ == label.value && same_place(open_card_, input.card_position())) {
      input.fail(label.where, std::string(kind_) + " " + std::to_string(label.value) + " refers to itself");
    }
    const T* item = find(label.value);
    if (item == nullptr) {
      input.fail(label.where, std::string(kind_) + " " + std::to_string(label.value) +
                                  (label.constant.empty() ? "" : " (" + label.constant + ")") + " is not defined" +
                                  (items_.empty() ? "" : " before this card"));
    }
    return *item;
  }

 private:
  const char* kind_;
  std::unordered_map<std::uint32_t, std::pair<SourcePosition, T>> items_;
  std::unordered_set<std::uint32_t> broken_;
  std::optional<std::uint32_t> open_;  // the last label announced, and its card
  SourcePosition open_card_;
};

/// Number of entities announced in the control data and found in the deck.
struct Count {
  const char* card;
  std::optional<std::int64_t> announced;
  SourcePosition where;
  std::int64_t found = 0;
};

struct Nothing {};

struct Context {
  Context(Diagnostics& diagnostics, ElementTable table) : input(diagnostics), elements(table) {}

  Input input;
  ElementTable elements;
  Deck deck;

  Registry<NodeIndex> nodes{"node"};
  Registry<Nothing> dummy_nodes{"dummy node"};
  Registry<Frame> references{"reference"};
  Registry<DrivePtr> drives{"drive caller"};
  Registry<Law1> laws1{"1D constitutive law"};
  Registry<Law3> laws3{"3D constitutive law"};
  Registry<Law6> laws6{"6D constitutive law"};
  Registry<Nothing> bodies{"body"};
  Registry<FileTablePtr> file_drivers{"file driver"};
  int file_drives = 0;                             ///< drives read so far that read a file driver
  std::unordered_set<std::uint32_t> file_callers;  ///< drive callers with such a drive in them
  Registry<std::size_t> joints{"joint"};           ///< index in Deck::joints
  Registry<std::size_t> genels{"genel"};
  Registry<std::size_t> forces{"force"};
  Registry<std::size_t> abstract_nodes{"abstract node"};
  std::map<std::string, ScalarFunctionPtr> scalar_functions;

  Count node_count{"structural nodes", {}, {}};
  Count body_count{"rigid bodies", {}, {}};
  Count joint_count{"joints", {}, {}};
  Count force_count{"forces", {}, {}};
  Count abstract_node_count{"abstract nodes", {}, {}};
  Count genel_count{"genels", {}, {}};
  Count driver_count{"file drivers", {}, {}};
  Count gravity_count{"gravity", {}, {}};

  std::uint64_t initial_value_cards = 0;  ///< one bit for every card of the initial value block seen
  bool state_drives = false;              ///< drives that read the state are welcome (AllowStateDrives)
  bool muscle_module_loaded = false;
  bool muscle_module_missed = false;  ///< the warning has been given

  double initial_time() const { return deck.initial_value.initial_time; }
  double time_step() const { return deck.initial_value.time_step; }

  /// Reads the label of a node that must exist; dummy nodes do not count.
  NodeIndex node() {
    const Label label = input.label("a node label");
    if (dummy_nodes.find(label.value) != nullptr) {
      input.fail(label.where,
                 "node " + std::to_string(label.value) + " is a dummy node, expected a node with unknowns");
    }
    return nodes.get(input, label);
  }
  Frame frame(NodeIndex index) const {
    const NodeData& node = deck.nodes[index];
    return {node.x, node.R, node.v, node.w};
  }
};

/// As long as it lives, drives may read the state: their user has the derivatives by them.
class AllowStateDrives {
 public:
  explicit AllowStateDrives(Context& context) : context_(context), before_(context.state_drives) {
    context_.state_drives = true;
  }
  ~AllowStateDrives() { context_.state_drives = before_; }
  AllowStateDrives(const AllowStateDrives&) = delete;
  AllowStateDrives& operator=(const AllowStateDrives&) = delete;

 private:
  Context& context_;
  bool before_;
};

/// The identity of a thing: its constant's name or "kind label".
inline Identity identity(const Label& label, const char* kind) {
  return {label.value, label.constant.empty() ? std::string(kind) + " " + std::to_string(label.value) : label.constant,
          label.where};
}

}  // namespace mbdae::reading
