// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/muscle_reader.h"

#include "mbdae/deck/drive_reader.h"

namespace mbdae::reading {
namespace {

/// Default of the reference velocity: four reference lengths per second.
constexpr double kLengthsPerSecond = 4.0;

ShortRangeData read_short_range(Input& input) {
  static constexpr const char* kModels[] = {"exponential", "linear"};
  ShortRangeData out;
  if (input.more() && input.take("model") && input.keyword(kModels, "short range model") == 1) {
    out.model = ShortRangeModel::linear;
  }
  if (input.more() && input.take("gamma")) out.gamma = input.real("gamma");
  if (input.more() && input.take("delta")) out.delta = input.positive("delta");
  return out;
}

}  // namespace

MuscleLaw read_muscle(Context& context, const SourcePosition& where) {
  static constexpr const char* kModels[] = {"pennestri", "erf"};
  Input& input = context.input;
  if (!context.muscle_module_loaded && !context.muscle_module_missed) {
    context.muscle_module_missed = true;
    input.diagnostics().warning(where, "the muscle law needs the card `module load: \"libmodule-muscles\";` in MBDyn");
  }
  MuscleLaw law;
  if (input.more()) input.take("help");  // prints the syntax there
  if (input.more() && input.take("model") && input.keyword(kModels, "muscle model") == 1) law.model = MuscleModel::erf;
  const bool initial = input.more() && input.take("initial length");
  if (initial) law.Li = input.positive("the initial length [m]");
  input.require("reference length");
  law.L0 = input.positive("the reference length [m]");
  if (!initial) law.Li = law.L0;
  law.V0 = kLengthsPerSecond * law.L0;
  if (input.more() && input.take("reference velocity")) law.V0 = input.positive("the reference velocity [m/s]");
  input.require("reference force");
  law.F0 = input.positive("the reference force [N]");
  input.require("activation");
  {
    const AllowStateDrives allow(context);
    law.activation = read_drive(context);
  }
  if (input.more() && input.take("activation check")) law.activation_check = input.yes_no();
  if (const SourcePosition here = input.where(); input.more() && input.take("warn")) {
    const bool warn = input.yes_no();
    if (warn != law.activation_check) {
      input.diagnostics().warning(
          here, "`warn` sets the activation check, as it does in MBDyn: write the same answer in both");
    }
    law.activation_check = warn;
  }
  if (input.more() && input.take("ergonomy")) law.ergonomy = input.yes_no();
  if (const SourcePosition here = input.where(); input.more() && input.take("reflexive")) {
    if (law.ergonomy) input.fail(here, "`reflexive` and `ergonomy, yes` exclude each other");
    if (law.model != MuscleModel::pennestri) {
      input.diagnostics().warning(here, "a reflexive muscle has the model pennestri, not erf");
      law.model = MuscleModel::pennestri;
    }
    ReflexData reflex;
    input.require("proportional gain");
    reflex.proportional_gain = read_drive(context);
    input.require("derivative gain");
    reflex.derivative_gain = read_drive(context);
    input.require("reference length");
    reflex.reference_length = read_drive(context);
    law.reflex = std::move(reflex);
    if (input.more() && input.take("short range stiffness")) law.short_range = read_short_range(input);
  }
  if (input.more() && input.take("prestress")) law.prestress = input.real("the prestress [N]");
  if (input.more() && input.take("prestrain")) law.prestrain = read_drive(context);
  // The items have a fixed order: say so when one of them comes late.
  static constexpr const char* kItems[] = {
      "model",           "initial length", "reference length",      "reference velocity",
      "reference force", "activation",     "activation check",      "warn",
      "ergonomy",        "reflexive",      "short range stiffness", "prestress"};
  if (input.more()) {
    if (const auto words = input.peek_words()) {
      for (const char* item : kItems) {
        if (words->is(item)) {
          input.fail(words->where,
                     std::string("`") + item +
                         "` is out of place; the order of the muscle law is: model, initial length, "
                         "reference length, reference velocity, reference force, activation, activation check, warn, "
                         "ergonomy, reflexive (with short range stiffness), prestress, prestrain");
        }
      }
    }
  }
  return law;
}

}  // namespace mbdae::reading
