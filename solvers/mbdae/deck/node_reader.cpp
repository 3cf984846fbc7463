// Structural nodes and reference frames.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/geometry.h"

namespace mbdae::reading {
namespace {

/// NODE [, position, x] [, orientation, R] [, pivot node, NODE [, position, x] [, orientation, R]]
void read_relative_frame(Context& context, DummyNodeData* dummy) {
  Input& input = context.input;
  dummy->relative_to = context.node();
  const auto read_place = [&](NodeIndex index) {
    const Frame frame = context.frame(index);
    Place place;
    place.node = &frame;
    if (input.more() && input.take("position")) read_position(context, place);
    if (input.more() && input.take("orientation")) read_orientation(context, place);
  };
  read_place(*dummy->relative_to);
  if (input.more() && input.take("pivot node")) read_place(context.node());
}

void read_dummy(Context& context, const Label& label) {
  Input& input = context.input;
  DummyNodeData dummy;
  dummy.id = identity(label, "node");
  dummy.base = context.node();
  static constexpr const char* kKinds[] = {"offset", "relative frame"};
  if (input.keyword(kKinds, "dummy node type") == 1) {
    read_relative_frame(context, &dummy);
    if (input.more()) skip_orientation_description(input);
    if (input.more()) skip_output(input);
    input.end_card();
    context.deck.dummy_nodes.push_back(std::move(dummy));
    return;
  }
  const Frame base = context.frame(dummy.base);
  Place place;
  place.node = &base;
  dummy.offset = read_position(context, place);
  dummy.rotation = read_orientation(context, place);
  if (input.more()) skip_orientation_description(input);
  if (input.more()) skip_output(input);
  input.end_card();
  context.deck.dummy_nodes.push_back(std::move(dummy));
}

/// [, assembly, kpos, kvel, yes|no] [, scale, ...] [, output, ...] [, accelerations, ...], in this order.
void skip_node_options(Input& input) {
  static constexpr const char* kOptions[] = {"assembly", "scale", "output", "accelerations"};
  int last = -1;
  while (input.more()) {
    const SourcePosition where = input.where();
    const int option = input.keyword(kOptions, "node option");
    if (option <= last) {
      input.fail(where, std::string("the node option `") + kOptions[option] +
                            "` comes too late, expected the order: " + joined(kOptions) + ", each at most once");
    }
    last = option;
    switch (option) {
      case 0:
        input.real("the stiffness of the position in assembly");
        input.real("the stiffness of the velocity in assembly");
        input.yes_no();
        break;
      case 1:
        if (!input.take("default")) input.real("a residual scale factor");
        break;
      default:
        input.yes_no();
        break;
    }
  }
}

}  // namespace

void skip_name(Input& input) {
  if (input.more() && input.take("name")) input.string("a name in quotes");
}

bool skip_output(Input& input) {
  if (!input.take("output")) return false;
  input.yes_no();
  return true;
}

void read_reference(Context& context) {
  const Label label = context.input.label("a reference label");
  skip_name(context.input);
  context.references.announce(context.input, label);
  const Frame frame = read_frame(context, false);
  context.input.end_card();
  context.references.define(label, frame);
}

void read_structural(Context& context) {
  static constexpr const char* kKinds[] = {"dynamic", "static", "dummy", "modal"};
  static constexpr const char* kOthers[] = {"dynamic displacement", "static displacement", "displacement"};
  Input& input = context.input;
  ++context.node_count.found;
  const Label label = input.label("a node label");
  // Both kinds share one label space.
  if (context.dummy_nodes.find(label.value) != nullptr) {
    input.fail(label.where, "node " + std::to_string(label.value) + " is defined already, as a dummy node");
  }
  context.nodes.announce(input, label);
  skip_name(input);
  input.need([&] { return "a node type: " + joined(kKinds); });
  if (const auto words = input.peek_words()) {
    for (const char* other : kOthers) {
      if (words->is(other)) input.fail(words->where, std::string("not supported: the node type `") + other + "`");
    }
  }
  const int kind = input.keyword(kKinds, "node type");
  if (kind == 2) {
    read_dummy(context, label);
    context.nodes.forget(label);
    context.dummy_nodes.define(label, {});
    return;
  }
  NodeData node;
  node.id = identity(label, "node");
  node.kind = kind == 0 ? NodeKind::dynamic_node : kind == 1 ? NodeKind::static_node : NodeKind::modal_node;
  Frame frame;
  input.need("a position");
  if (input.take("at reference")) {
    frame = context.references.get(input, input.label("the label of a reference"));
  } else {
    frame = read_frame(context, true);
  }
  skip_node_options(input);
  input.end_card();
  node.x = frame.x;
  node.R = frame.R;
  node.v = frame.v;
  node.w = frame.w;
  context.deck.nodes.push_back(std::move(node));
  context.nodes.define(label, context.deck.nodes.size() - 1);
}

}  // namespace mbdae::reading
