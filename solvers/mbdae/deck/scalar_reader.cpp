// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/scalar_reader.h"

#include <array>
#include <cctype>
#include <string>
#include <utility>

#include "mbdae/deck/element_reader.h"

namespace mbdae::reading {

namespace {

constexpr const char* kOrders[] = {"algebraic", "differential"};

std::size_t abstract_node(Context& context, const Label& label) {
  return context.abstract_nodes.get(context.input, label);
}

NodeIndex structural_node(Context& context, const Label& label) {
  if (context.dummy_nodes.find(label.value) != nullptr) {
    context.input.fail(label.where,
                       "node " + std::to_string(label.value) + " is a dummy node, expected a node with unknowns");
  }
  return context.nodes.get(context.input, label);
}

/// structural or abstract, after a node's label.
bool read_structural_word(Input& input) {
  static constexpr const char* kTypes[] = {"structural", "abstract"};
  static constexpr const char* kOthers[] = {"parameter", "electric", "hydraulic", "thermal"};
  input.need("the type of the node: structural or abstract");
  if (const auto words = input.peek_words()) {
    for (const char* other : kOthers) {
      if (words->is(other)) input.fail(words->where, std::string("not supported: the node type `") + other + "`");
    }
  }
  return input.keyword(kTypes, "node type") == 0;
}

std::shared_ptr<const Signal> signal_of(Context& context, Signal::Source source, std::size_t index, int quantity) {
  for (const auto& known : context.deck.signals) {
    if (known->source == source && known->index == index && known->quantity == quantity) return known;
  }
  context.deck.signals.push_back(std::make_shared<const Signal>(source, index, quantity));
  return context.deck.signals.back();
}

/// "X[3]" -> "X" and 3; without brackets the number is 0.
std::pair<std::string, int> split(const std::string& name) {
  const std::size_t open = name.find('[');
  if (open == std::string::npos || name.size() != open + 3 || name.back() != ']' ||
      std::isdigit(static_cast<unsigned char>(name[open + 1])) == 0) {
    return {name, 0};
  }
  return {name.substr(0, open), name[open + 1] - '0'};
}

}  // namespace

void read_abstract(Context& context) {
  Input& input = context.input;
  ++context.abstract_node_count.found;
  const Label label = input.label("a node label");
  skip_name(input);
  context.abstract_nodes.announce(input, label);
  AbstractNodeData node;
  node.id = identity(label, "abstract node");
  input.need("the order of the node: algebraic or differential");
  node.differential = input.keyword(kOrders, "order of an abstract node") == 1;
  if (input.more() && input.take("value")) node.value = input.real("the initial value");
  if (const SourcePosition where = input.where(); input.more() && input.take("derivative")) {
    if (!node.differential) input.fail(where, "an algebraic node has no derivative");
    node.rate = input.real("the initial derivative");
  }
  if (input.more()) skip_output(input);
  input.end_card();
  context.deck.abstract_nodes.push_back(std::move(node));
  context.abstract_nodes.define(label, context.deck.abstract_nodes.size() - 1);
}

bool is_algebraic(const Context& context, const DofData& dof) {
  return !dof.structural && !context.deck.abstract_nodes[dof.node].differential;
}

DofData read_dof(Context& context, Order order) {
  Input& input = context.input;
  const Label label = input.label("a node label");
  DofData dof;
  dof.structural = read_structural_word(input);
  if (dof.structural) {
    dof.node = structural_node(context, label);
    const SourcePosition where = input.where();
    const std::int64_t component = input.integer("the number of the degree of freedom, 1 to 6");
    if (component < 1 || component > 6) {
      input.fail(where, "found degree of freedom " + std::to_string(component) + ", expected 1 to 6");
    }
    dof.component = static_cast<int>(component) - 1;
  } else {
    dof.node = abstract_node(context, label);
  }
  if (is_algebraic(context, dof)) {
    if (const auto words = input.more() ? input.peek_words() : std::nullopt;
        words && (words->is(kOrders[0]) || words->is(kOrders[1]))) {
      input.fail(words->where, "the node is algebraic: its order must not be given");
    }
    return dof;
  }
  if (order == Order::needed) {
    input.need("the order of the degree of freedom: algebraic or differential");
    dof.rate = input.keyword(kOrders, "order") == 1;
  } else if (input.more()) {
    dof.rate = input.take_any(kOrders) == 1;
  }
  return dof;
}

std::shared_ptr<const Signal> read_dof_signal(Context& context) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  const DofData dof = read_dof(context);
  if (!dof.structural) return signal_of(context, Signal::Source::abstract_node, dof.node, dof.rate ? 1 : 0);
  if (dof.component >= 3 && !dof.rate) {
    input.fail(where, "a rotation has no value of its own: read its `differential` order, or the node's \"Phi[k]\"");
  }
  const NodeSignal kind = dof.component >= 3 ? NodeSignal::angular_velocity
                          : dof.rate         ? NodeSignal::velocity
                                             : NodeSignal::position;
  return signal_of(context, Signal::Source::node, dof.node, static_cast<int>(kind) + dof.component % 3);
}

std::shared_ptr<const Signal> read_node_signal(Context& context) {
  static constexpr const char* kForms[] = {"string", "index"};
  static constexpr std::array<std::pair<const char*, NodeSignal>, 4> kQuantities{
      {{"X", NodeSignal::position},
       {"XP", NodeSignal::velocity},
       {"Omega", NodeSignal::angular_velocity},
       {"Phi", NodeSignal::rotation_vector}}};
  Input& input = context.input;
  const Label label = input.label("a node label");
  const bool structural = read_structural_word(input);
  const std::size_t node = structural ? structural_node(context, label) : abstract_node(context, label);
  input.need("`string` and the name of a quantity, or `index` and its number");
  const bool by_name = input.keyword(kForms, "form of a node drive") == 0;
  const SourcePosition where = input.where();
  if (!by_name) {
    const std::int64_t k = input.integer("the number of the quantity");
    if (structural && k >= 1 && k <= 3) {
      return signal_of(context, Signal::Source::node, node, static_cast<int>(k) - 1);
    }
    input.fail(where, "not supported: quantity " + std::to_string(k) + " of a node; give its name: `string, \"X[3]\"`");
  }
  const std::string name = input.string("the name of a quantity in quotes");
  if (!structural) {
    if (name == "x") return signal_of(context, Signal::Source::abstract_node, node, 0);
    if (name == "xP" && context.deck.abstract_nodes[node].differential) {
      return signal_of(context, Signal::Source::abstract_node, node, 1);
    }
    input.fail(where, "found the quantity " + quoted(name) + " of an abstract node, expected \"x\"" +
                          (context.deck.abstract_nodes[node].differential ? " or \"xP\"" : ""));
  }
  const auto [quantity, component] = split(name);
  for (const auto& [known, kind] : kQuantities) {
    if (quantity == known && component >= 1 && component <= 3) {
      return signal_of(context, Signal::Source::node, node, static_cast<int>(kind) + component - 1);
    }
  }
  if (quantity == "XPP" || quantity == "OmegaP" || quantity == "E" || quantity == "x" || quantity == "xP" ||
      quantity == "omega") {
    input.fail(where, "not supported: the quantity " + quoted(name) + " of a node");
  }
  input.fail(where,
             "found the quantity " + quoted(name) + ", expected \"X[k]\", \"XP[k]\", \"Omega[k]\" or \"Phi[k]\"");
}

std::shared_ptr<const Signal> read_element_signal(Context& context) {
  static constexpr const char* kTypes[] = {"joint"};
  static constexpr const char* kForms[] = {"string"};
  Input& input = context.input;
  const Label label = input.label("an element label");
  input.need("the type of the element: joint");
  if (const auto words = input.peek_words(); words && !words->is("joint")) {
    input.fail(words->where, "not supported: a drive that reads an element `" + words->written + "`");
  }
  input.keyword(kTypes, "element type");
  const std::size_t joint = context.joints.get(input, label);
  input.need("`string` and the name of a quantity");
  input.keyword(kForms, "form of an element drive");
  const SourcePosition where = input.where();
  const std::string name = input.string("the name of a quantity in quotes");
  const ElementType& type = *context.deck.joints[joint].type;
  std::string known;
  for (std::size_t k = 0; k < type.signals.size(); ++k) {
    if (name == type.signals[k]) return signal_of(context, Signal::Source::joint, joint, static_cast<int>(k));
    known += (k == 0 ? "" : ", ") + std::string(type.signals[k]);
  }
  input.fail(where, "not supported: the quantity " + quoted(name) + " of a " + type.name +
                        (known.empty() ? "" : "; there are: " + known));
}

}  // namespace mbdae::reading
