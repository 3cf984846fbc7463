// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/law_reader.h"

#include <cmath>
#include <type_traits>
#include <utility>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/geometry.h"
#include "mbdae/deck/muscle_reader.h"
#include "mbdae/deck/scalar_reader.h"

namespace mbdae::reading {
namespace {

template <int N>
using Matrix = Eigen::Matrix<double, N, N>;
template <int N>
using Vector = Eigen::Matrix<double, N, 1>;

enum LawKind {
  kReference,
  kElastic,
  kElasticIsotropic,
  kElasticGeneric,
  kViscous,
  kViscousIsotropic,
  kViscousGeneric,
  kViscoelastic,
  kViscoelasticIsotropic,
  kViscoelasticGeneric,
  kCubicElastic,
  kCubicViscoelastic,
  kMuscle,
  kDoubleLinearElastic,
  kDoubleLinearViscoelastic,
  kFunctionElastic,
  kFunctionElasticIsotropic,
  kFunctionElasticOrthotropic,
};

constexpr const char* kLaws[] = {"reference",
                                 "linear elastic",
                                 "linear elastic isotropic",
                                 "linear elastic generic",
                                 "linear viscous",
                                 "linear viscous isotropic",
                                 "linear viscous generic",
                                 "linear viscoelastic",
                                 "linear viscoelastic isotropic",
                                 "linear viscoelastic generic",
                                 "cubic elastic generic",
                                 "cubic viscoelastic generic",
                                 "muscle",
                                 "double linear elastic",
                                 "double linear viscoelastic",
                                 "scalar function elastic",
                                 "scalar function elastic isotropic",
                                 "scalar function elastic orthotropic"};

constexpr const char* kOtherLaws[] = {"array",
                                      "ann elastic",
                                      "ann viscoelastic",
                                      "axial wrapper",
                                      "bistop",
                                      "cubic elastic",
                                      "damper hydraulic",
                                      "elastomer",
                                      "file driven",
                                      "hydraulic damper",
                                      "inverse square elastic",
                                      "isotropic hardening elastic",
                                      "invariant angular",
                                      "linear elastic bistop",
                                      "linear elastic generic axial torsion coupling",
                                      "linear elastic orthotropic",
                                      "linear time variant viscoelastic generic",
                                      "linear turbulent viscoelastic",
                                      "linear viscoelastic bistop",
                                      "linear viscoelastic generic axial torsion coupling",
                                      "linear viscoelastic orthotropic",
                                      "log elastic",
                                      "mooney rivlin elastic",
                                      "neo hookean elastic",
                                      "nlp elastic",
                                      "nlp viscoelastic",
                                      "nlp viscous",
                                      "nlsf elastic",
                                      "nlsf viscoelastic",
                                      "nlsf viscous",
                                      "scalar function viscoelastic isotropic",
                                      "scalar function viscoelastic orthotropic",
                                      "scalar function viscous isotropic",
                                      "shock absorber",
                                      "symbolic elastic",
                                      "symbolic viscoelastic",
                                      "symbolic viscous",
                                      "turbulent elastic",
                                      "viscous",
                                      "zener"};

template <int N>
Matrix<N> read_generic(Input& input, const char* what) {
  if constexpr (N == 1) {
    return Matrix<1>::Constant(input.real(what));
  } else if constexpr (N == 3) {
    return read_mat3(input, what);
  } else {
    return read_mat6(input, what);
  }
}

template <int N>
Vector<N> read_components(Input& input, const char* what) {
  if constexpr (N == 1) {
    return Vector<1>::Constant(input.real(what));
  } else if constexpr (N == 3) {
    return read_vec3(input, what);
  } else {
    return read_vec6(input, what);
  }
}

template <int N>
Matrix<N> read_isotropic(Input& input, const char* what) {
  return Matrix<N>::Identity() * input.real(what);
}

/// [, prestress, f] [, prestrain, drive]
template <class L>
void read_suffix(Context& context, L* law) {
  constexpr int N = std::remove_cvref_t<decltype(law->prestress)>::RowsAtCompileTime;
  Input& input = context.input;
  if (input.more() && input.take("prestress"))
    law->prestress = read_components<N>(input, "a component of the prestress");
  if (input.more() && input.take("prestrain")) {
    if constexpr (N == 1) {
      law->prestrain = read_scalar_drive(context);
    } else if constexpr (N == 3) {
      law->prestrain = read_vector_drive(context, nullptr);
    } else {
      law->prestrain = read_vector_drive6(context);
    }
  }
  if (input.more()) {
    if (const auto words = input.peek_words(); words && words->is("prestress")) {
      input.fail(words->where, "`prestress` comes before `prestrain`, and once");
    }
  }
}

template <int N>
LinearLaw<N> read_linear(Context& context, int kind) {
  Input& input = context.input;
  LinearLaw<N> law;
  switch (kind) {
    case kElastic:
    case kElasticIsotropic:
      law.K = read_isotropic<N>(input, "the stiffness");
      break;
    case kElasticGeneric:
      law.K = read_generic<N>(input, "an element of the stiffness");
      break;
    case kViscous:
    case kViscousIsotropic:
      law.C = read_isotropic<N>(input, "the damping");
      break;
    case kViscousGeneric:
      law.C = read_generic<N>(input, "an element of the damping");
      break;
    default: {
      const bool generic = kind == kViscoelasticGeneric;
      law.K =
          generic ? read_generic<N>(input, "an element of the stiffness") : read_isotropic<N>(input, "the stiffness");
      input.need("the damping, or `proportional` and a factor");
      if (!generic && input.at_words() && !input.symbols().find(input.peek_text())) {
        input.require("proportional");
        law.C = law.K * input.real("the factor of proportional damping");
      } else if (input.take("proportional")) {
        law.C = law.K * input.real("the factor of proportional damping");
      } else {
        law.C = generic ? read_generic<N>(input, "an element of the damping") : read_isotropic<N>(input, "the damping");
      }
    }
  }
  const SourcePosition where = input.where();
  read_suffix(context, &law);
  // MBDyn takes an isotropic viscoelastic law without stiffness for a viscous one.
  const bool without_stiffness = (kind == kViscoelastic || kind == kViscoelasticIsotropic) && law.K.isZero(0.0);
  if (kind == kViscous || kind == kViscousIsotropic || kind == kViscousGeneric || without_stiffness) {
    if (!law.prestress.isZero(0.0)) {
      input.diagnostics().warning(where, "the prestress of a viscous law has no effect, as in MBDyn");
    }
    law.prestress.setZero();
    law.prestrain.terms.clear();  // of a stiffness that is not there
  }
  return law;
}

template <int N>
CubicLaw<N> read_cubic(Context& context, bool viscous) {
  Input& input = context.input;
  CubicLaw<N> law;
  law.K1 = read_components<N>(input, "the linear stiffness");
  law.K2 = read_components<N>(input, "the quadratic stiffness");
  law.K3 = read_components<N>(input, "the cubic stiffness");
  if (viscous) law.C = read_generic<N>(input, "an element of the damping");
  read_suffix(context, &law);
  return law;
}

/// Two stiffnesses, the second one beyond either limit.
FunctionLaw<1> read_double_linear(Context& context, bool viscous) {
  Input& input = context.input;
  const double first = input.real("the stiffness between the limits");
  const double upper = input.real("the upper strain");
  const SourcePosition where = input.where();
  const double lower = input.real("the lower strain");
  if (!(upper > lower)) {
    input.fail(where, "found the lower strain " + number_text(lower) + ", expected one below the upper, " +
                          number_text(upper));
  }
  const double second = input.real("the stiffness beyond the limits");
  FunctionLaw<1> law;
  if (viscous) {
    law.C(0, 0) = input.real("the damping");
    if (const auto words = input.more() ? input.peek_words() : std::nullopt; words && words->is("second damping")) {
      input.fail(words->where, "not supported: the second damping of a `double linear viscoelastic` law");
    }
  }
  law.elastic[0] = broken_line({lower - 1.0, lower, upper, upper + 1.0},
                               {first * lower - second, first * lower, first * upper, first * upper + second});
  read_suffix(context, &law);
  return law;
}

template <int N>
FunctionLaw<N> read_function_law(Context& context, bool each) {
  Input& input = context.input;
  FunctionLaw<N> law;
  if (!each) law.elastic.fill(scalar_function(context));
  for (int i = 0; i < N && each; ++i) {
    input.need([&] { return "function " + std::to_string(i + 1) + " of " + std::to_string(N) + ", or `null`"; });
    if (!input.take("null")) law.elastic[static_cast<std::size_t>(i)] = scalar_function(context);
  }
  read_suffix(context, &law);
  return law;
}

/// The kind of law, or a message that names it.
int read_kind(Input& input) {
  input.need([&] { return "a constitutive law: " + joined(kLaws); });
  const int kind = input.take_any(kLaws);
  if (kind >= 0) return kind;
  if (const auto words = input.peek_words()) {
    for (const char* other : kOtherLaws) {
      if (words->is(other))
        input.fail(words->where, std::string("not supported: the constitutive law `") + other + "`");
    }
  }
  return input.keyword(kLaws, "constitutive law");  // fails with the choices
}

template <int N, class L>
L read_law(Context& context, const Registry<L>& named) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  const int kind = read_kind(input);
  if (kind == kReference) return named.get(input, input.label("the label of a constitutive law"));
  if (kind == kCubicElastic || kind == kCubicViscoelastic) {
    if constexpr (N == 6) {
      input.fail(where, "not supported: cubic laws of a deformable joint (6D)");
    } else {
      return read_cubic<N>(context, kind == kCubicViscoelastic);
    }
  }
  if (kind == kDoubleLinearElastic || kind == kDoubleLinearViscoelastic) {
    if constexpr (N == 1) return read_double_linear(context, kind == kDoubleLinearViscoelastic);
    input.fail(where,
               std::string("not supported: the law `") + kLaws[kind] + "` of " + std::to_string(N) + " components");
  }
  if (kind == kFunctionElastic || kind == kFunctionElasticIsotropic || kind == kFunctionElasticOrthotropic) {
    if constexpr (N != 6) return read_function_law<N>(context, kind == kFunctionElasticOrthotropic);
    input.fail(where, "not supported: laws of scalar functions of a deformable joint (6D)");
  }
  if (kind == kMuscle) input.fail(where, "the muscle law is for rods (1D), not for this element");
  return read_linear<N>(context, kind);
}

/// Tells the expression evaluator what model::current("L0") is, for as long as it lives.
class CurrentLength {
 public:
  CurrentLength(Input& input, const double* length) : input_(input) { input_.set_current_length(length); }
  ~CurrentLength() { input_.set_current_length(nullptr); }
  CurrentLength(const CurrentLength&) = delete;
  CurrentLength& operator=(const CurrentLength&) = delete;

 private:
  Input& input_;
};

}  // namespace

Law1 read_law1(Context& context, const double* rod_length) {
  const CurrentLength current(context.input, rod_length);
  const SourcePosition where = context.input.where();
  Law1 law;
  if (context.input.more() && context.input.take("muscle")) {
    law = read_muscle(context, where);
  } else {
    law = read_law<1>(context, context.laws1);
  }
  if (const auto* muscle = std::get_if<MuscleLaw>(&law); muscle != nullptr && rod_length != nullptr) {
    // 1e-9 relative: lengths are written with 9 digits or more.
    if (std::abs(muscle->Li - *rod_length) > 1e-9 * *rod_length) {
      context.input.diagnostics().warning(where, "the muscle's initial length " + number_text(muscle->Li) +
                                                     " m is not the length of its rod, " + number_text(*rod_length) +
                                                     " m: the law's x is not the rod's length over L0");
    }
  }
  return law;
}

Law1 read_spring_law1(Context& context) {
  const SourcePosition where = context.input.where();
  Law1 law = read_law<1>(context, context.laws1);
  if (std::holds_alternative<MuscleLaw>(law)) {
    context.input.fail(where, "the muscle law is for rods, not for this element");
  }
  return law;
}

Law3 read_law3(Context& context) { return read_law<3>(context, context.laws3); }
Law6 read_law6(Context& context) { return read_law<6>(context, context.laws6); }

void read_constitutive_law(Context& context) {
  Input& input = context.input;
  const Label label = input.label("a constitutive law label");
  skip_name(input);
  const SourcePosition where = input.where();
  const std::int64_t dimension = input.integer("the dimension of the law: 1, 3 or 6");
  const auto define = [&](auto& registry, auto&& read) {
    registry.announce(input, label);
    auto law = read();
    input.end_card();
    registry.define(label, std::move(law));
  };
  if (dimension == 1) {
    define(context.laws1, [&] { return read_law1(context, nullptr); });
  } else if (dimension == 3) {
    define(context.laws3, [&] { return read_law3(context); });
  } else if (dimension == 6) {
    define(context.laws6, [&] { return read_law6(context); });
  } else {
    input.fail(where, "found dimension " + std::to_string(dimension) + ", expected 1, 3 or 6");
  }
}

}  // namespace mbdae::reading
