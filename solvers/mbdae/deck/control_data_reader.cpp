// The control data block.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/block_reader.h"
#include "mbdae/deck/geometry.h"

namespace mbdae::reading {
namespace {

/// Cards that change output or the initial assembly only: accepted without effect.
constexpr const char* kWithoutEffect[] = {"print",
                                          "default output",
                                          "default scale",
                                          "output frequency",
                                          "output precision",
                                          "output meter",
                                          "output results",
                                          "output units",
                                          "initial stiffness",
                                          "tolerance",
                                          "max iterations",
                                          "use",
                                          "omega rotates",
                                          "initial assembly of deformable and force elements",
                                          "default aerodynamic output",
                                          "default beam output",
                                          "title",
                                          "select timeout",
                                          "make restart file",
                                          "default element output"};
/// Cards that count what is not read here: only zero will do.
constexpr const char* kOtherCounts[] = {"electric nodes",
                                        "hydraulic nodes",
                                        "parameter nodes",
                                        "thermal nodes",
                                        "aerodynamic elements",
                                        "aeromodals",
                                        "air properties elements",
                                        "automatic structural elements",
                                        "beams",
                                        "bulk elements",
                                        "electric bulk elements",
                                        "electric elements",
                                        "hydraulic elements",
                                        "induced velocity elements",
                                        "inertia",
                                        "joint regularizations",
                                        "loadable elements",
                                        "plates",
                                        "rotors",
                                        "surface loads",
                                        "thermal elements",
                                        "solids",
                                        "membranes",
                                        "shells"};
constexpr const char* kKnown[] = {"structural nodes",
                                  "abstract nodes",
                                  "genels",
                                  "rigid bodies",
                                  "joints",
                                  "forces",
                                  "file drivers",
                                  "gravity",
                                  "model",
                                  "skip initial joint assembly",
                                  "default orientation",
                                  "use automatic differentiation"};

/// What `default output` may name.
constexpr const char* kOutputs[] = {"all",
                                    "none",
                                    "except",
                                    "reference frames",
                                    "drive callers",
                                    "abstract nodes",
                                    "electric nodes",
                                    "hydraulic nodes",
                                    "structural nodes",
                                    "accelerations",
                                    "parameter nodes",
                                    "thermal nodes",
                                    "aerodynamic elements",
                                    "aeromodals",
                                    "air properties",
                                    "automatic structural elements",
                                    "beams",
                                    "bulk elements",
                                    "electric bulk elements",
                                    "electric elements",
                                    "forces",
                                    "genels",
                                    "gravity",
                                    "hydraulic elements",
                                    "induced velocity elements",
                                    "inertia",
                                    "joints",
                                    "loadable elements",
                                    "loadables",
                                    "plates",
                                    "rigid bodies",
                                    "rotors",
                                    "solids",
                                    "surface loads",
                                    "thermal elements",
                                    "user defined elements"};
/// What `use` may name.
constexpr const char* kAssembled[] = {"rigid bodies",
                                      "gravity",
                                      "forces",
                                      "beams",
                                      "aerodynamic elements",
                                      "joints",
                                      "loadable elements",
                                      "in assembly",
                                      "automatic structural elements",
                                      "genels",
                                      "rotors",
                                      "plates"};

/// The arguments of cards that have no effect, where what they may be is known.
void check_arguments(Input& input, const Words& card) {
  const auto all_of = [&](Choices choices, const char* what) {
    while (input.more()) input.keyword(choices, what);
  };
  if (card.is("default output")) {
    all_of(kOutputs, "kind of output");
  } else if (card.is("use")) {
    all_of(kAssembled, "kind of element");
  } else if (card.is("omega rotates")) {
    input.yes_no();
  } else if (card.is("title")) {
    input.string("a title in quotes");
  } else if (card.is("output frequency")) {
    const SourcePosition where = input.where();
    const std::int64_t steps = input.integer("a number of time steps");
    if (steps < 1) input.fail(where, "found " + std::to_string(steps) + " time steps, expected 1 or more");
  } else {
    input.ignore_arguments();
  }
}

bool listed(const Words& card, Choices choices) {
  for (const char* choice : choices) {
    if (card.is(choice)) return true;
  }
  return false;
}

/// Number of entities; read whole so that the message can name the card.
void read_count(Context& context, Count* count) {
  Input& input = context.input;
  count->where = input.where();
  const std::int64_t value = input.integer("a number of entities");
  if (value < 0) input.fail(count->where, "found " + std::to_string(value) + ", expected 0 or more");
  count->announced = value;
}

}  // namespace

void read_control_data_card(Context& context, const Words& card) {
  static constexpr const char* kModels[] = {"static"};
  static constexpr const char* kDescriptions[] = {"euler123", "euler313", "euler321", "orientation vector",
                                                  "orientation matrix"};
  Input& input = context.input;
  for (Count* count : {&context.node_count, &context.abstract_node_count, &context.body_count, &context.joint_count,
                       &context.genel_count, &context.force_count, &context.driver_count}) {
    if (!card.is(count->card)) continue;
    read_count(context, count);
    input.end_card();
    return;
  }
  if (card.is("gravity")) {
    context.gravity_count.announced = 1;
    context.gravity_count.where = card.where;
  } else if (card.is("model")) {
    input.keyword(kModels, "model");
    context.deck.control.static_model = true;
  } else if (card.is("skip initial joint assembly")) {
    context.deck.control.skip_initial_joint_assembly = true;
  } else if (card.is("default orientation")) {
    input.keyword(kDescriptions, "orientation description");
  } else if (card.is("use automatic differentiation")) {
    input.diagnostics().warning(card.where, "`use automatic differentiation` has no effect");
  } else if (listed(card, kWithoutEffect)) {
    check_arguments(input, card);
  } else if (listed(card, kOtherCounts)) {
    if (input.integer("a number of entities") != 0) {
      input.fail(card.where, "not supported: " + quoted(card.written) + " (only 0 of them)");
    }
  } else if (card.is("rigid body kinematics") || card.is("air properties")) {
    input.fail(card.where, "not supported: the card " + quoted(card.written));
  } else {
    std::vector<const char*> choices(std::begin(kKnown), std::end(kKnown));
    choices.insert(choices.end(), std::begin(kWithoutEffect), std::end(kWithoutEffect));
    const std::string hint = suggestion(card.text, choices);
    input.fail(card.where, (hint.empty() ? "not supported: the card " : "unknown card ") + quoted(card.written) +
                               " in the control data block, expected: " + joined(choices) + hint);
  }
  input.end_card();
}

void check_counts(Context& context) {
  for (const Count* count : {&context.node_count, &context.abstract_node_count, &context.body_count,
                             &context.joint_count, &context.genel_count, &context.force_count, &context.driver_count}) {
    const std::int64_t announced = count->announced.value_or(0);
    if (announced == count->found) continue;
    std::string message = std::string("the control data announce ") + std::to_string(announced) + " " + count->card +
                          ", the deck has " + std::to_string(count->found);
    if (!count->announced)
      message += " (add `" + std::string(count->card) + ": " + std::to_string(count->found) + ";`)";
    context.input.diagnostics().error(count->announced ? count->where : SourcePosition{}, std::move(message));
  }
  const Count& gravity = context.gravity_count;
  if (gravity.announced && gravity.found == 0) {
    context.input.diagnostics().error(gravity.where, "the control data announce gravity, the deck has none");
  } else if (!gravity.announced && gravity.found > 0) {
    context.input.diagnostics().error({}, "the deck has gravity, the control data do not announce it (add `gravity;`)");
  }
}

}  // namespace mbdae::reading
