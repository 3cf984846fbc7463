// Friction in a revolute hinge: a couple about its axis from the load that the hinge carries and how fast it turns.
//
//   e3 = R1 R1h e_3,  v = r e3.(w1 - w2),  N = max(|F|, N0),  M3 = s(f) N r
//   g[M1] += e3 M3,  g[M2] -= e3 M3
//   s(f) = f (`simple`) or f/sqrt(1 + f^2) (`simple plane hinge`)
//
// F are the hinge's three force reactions, r its radius, N0 the preload, mu(|v|) a scalar function, f the friction
// coefficient. The couple opposes the turning of node 1 against node 2.
//
//   modlugre, bristle deflection z (a state):
//     f = sigma0 z + sigma1 z' + sigma2 v
//     0 = v - z' - alpha(z, v) sigma0 z |v|/mu(|v|)
//     alpha = 0 if z and v have opposite signs or |z| <= kappa zs, 1 beyond zs = mu/sigma0, between them
//             1/2 + 1/2 sin(pi (|z| - (1 + kappa) zs/2)/((1 - kappa) zs))
//   discrete coulomb, coefficient f (algebraic):
//     stuck:    0 = -(v - v0), v0 = 0; with variable steps v0 is the speed at which sliding ended, some 1e-9 m/s
//     sliding:  0 = sign mu(|v|) + sigma2 v - f
//
// Stuck turns to sliding when |f| would exceed mu(0), sliding to stuck when v changes sign; a model starts stuck.
// Without preload the stuck model is singular where the hinge carries no load. Valid in any state where the hinge is
// not singular. Source: Dupont et al. (2002) as MBDyn has it, whose slope of mu has the wrong sign for v < 0
// (docs/conventions.md); ours is exact, the turning of e3 included. Tests "friction: tangents" (test_model_scalar.cpp),
// histories in tests/consistency/test_mbdyn_loop.py.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct FrictionData {
  double radius = 0.0, preload = 0.0;  ///< [m], [N]
  bool coulomb = false;                ///< discrete coulomb, otherwise modlugre
  double sigma0 = 0.0, sigma1 = 0.0, sigma2 = 0.0, kappa = 0.0;
  ScalarFunctionPtr mu;
  bool plane_hinge = false;  ///< shape function f/sqrt(1 + f^2)
};

/// The friction of a hinge whose three force reactions start at `force`, between nodes 1 and 2, about `axis` of node 1.
class Friction {
 public:
  Friction(const FrictionData& data, const NodeSlot& node1, const NodeSlot& node2, const Vec3& axis, int force,
           int scalar)
      : data_(data), node1_(node1), node2_(node2), axis_(axis), force_(force), scalar_(scalar) {}

  void assemble(const State& state, Equations& eq, bool tangent) const;

  ScalarInfo scalar() const;

  /// Takes the mode that the state asks for; true if it was another one. What comes free slides in the direction of its
  /// load, until it slides backwards by more than `still` [m/s], to which a variable step knows the speed of what is at
  /// rest; 0 for a step that is repeated with the mode it asks for.
  bool switch_mode(const State& state, double still);

  bool has_modes() const { return data_.coulomb; }

  /// Ends the mode: stuck turns to sliding in the direction that the load asks for, sliding to stuck. `still` as above.
  void end_mode(const State& state, double still);

  /// How far the state is from leaving its mode: positive before it. Zero is never crossed by modlugre.
  double mode_margin(const State& state) const;

  /// Whether that is the margin of a stuck hinge, which reads its load.
  bool margin_reads_load() const { return data_.coulomb && stuck_; }

  /// True if the coefficient has no effect at all at the state.
  bool ineffective(const State& state) const;

  /// The couple M3 at the state [N m].
  double couple(const State& state) const;

 private:
  struct Point {
    Vec3 e, w, F;     // axis, w1 - w2, force
    double v, N, f;   // sliding speed, load, coefficient
    double s, slope;  // s(f) and its slope
    bool loaded;      // |F| above the preload
  };
  struct Bristle {
    double value, by_z, by_v;  // alpha sigma0 z |v|/mu and its derivatives
  };
  Point point(const State& state) const;
  Bristle bristle(double z, double v) const;
  void let_go(const Point& at, double still);
  double most(bool slack) const;  ///< |f| of what is stuck

  FrictionData data_;
  NodeSlot node1_, node2_;
  Vec3 axis_;
  int force_, scalar_;
  bool stuck_ = true;
  double direction_ = 1.0;  // of sliding
  double least_ = 0.0;      // speed in that direction at which sliding ends [m/s]
  double creep_ = 0.0;      // v0: kept while stuck, so that velocities do not jump [m/s]
};

namespace reading {

/// [friction, radius, [preload, N0,] MODEL, ..., SHAPE]
std::optional<FrictionData> read_friction(Context& context);

}  // namespace reading

}  // namespace mbdae
