// Total joints that impose one or two components of a rotation: what is left free, by both integrators.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>

#include "mbdae/dae/analyses.h"
#include "mbdae/model/rotation.h"
#include "test_deck_support.h"

using namespace mbdae;

namespace {

// Entries of the imposed rotation vector at time t [rad].
double imposed_x(double t) { return 0.3 * (1.0 - std::cos(t)); }
double imposed_y(double t) { return 0.3 * (1.0 - std::cos(2.0 * t)); }

/// A body at a pin that imposes component 1, or 1 and 2, of its rotation vector; it starts to turn about axis 3.
Deck partly_turned(bool both, double time_step) {
  deck_test::DeckText text;
  std::ostringstream initial;
  initial << "initial time: 0.; final time: 1.; time step: " << time_step
          << "; method: ms, 0.6; tolerance: 1.e-11; max iterations: 50;\n";
  text.initial = initial.str();
  text.nodes = "structural: 1, dynamic, null, eye, null, 0., 0., 0.2;\n";
  text.elements = std::string("body: 1, 1, 1., null, diag, 1., 2., 3.;\njoint: 1, total pin joint, 1, ") +
                  "position constraint, 1, 1, 1, null, orientation constraint, active, " +
                  (both ? "active" : "inactive") +
                  ", inactive, component, cosine, 0., 1., 0.3, forever, 0., cosine, 0., 2., 0.3, forever, 0., 0.;\n";
  return deck_test::read_good(text);
}

/// Rotation vectors of the body at the instants, (n, 3) [rad].
Eigen::MatrixXd turned(const Deck& deck, const std::string& integrator) {
  IntegrateOptions options;
  options.integrator = integrator;
  options.rtol = 1e-10;
  options.atol = 1e-12;
  const Motion motion = integrate(deck, options);
  Eigen::MatrixXd out(motion.data.rows(), 3);
  const char* names[] = {"node 1.gx", "node 1.gy", "node 1.gz"};
  for (int i = 0; i < 3; ++i) {
    const auto at = std::find_if(motion.channels.begin(), motion.channels.end(),
                                 [&](const auto& channel) { return channel.name == names[i]; });
    REQUIRE(at != motion.channels.end());
    out.col(i) = motion.data.col(at - motion.channels.begin());
  }
  return out;
}

}  // namespace

TEST_CASE("partly imposed rotation: the rotation vector's components follow their drives") {
  // With IDA exactly; `ms` counts what is free from the last step, and comes to the same with the time step.
  for (const bool both : {true, false}) {
    const Eigen::Vector3d exact = turned(partly_turned(both, 0.01), "ida").bottomRows<1>();
    CHECK(std::abs(exact(0) - imposed_x(1.0)) < 1e-8);
    if (both) CHECK(std::abs(exact(1) - imposed_y(1.0)) < 1e-8);
    CHECK(std::abs(exact(2)) > 0.1);
    double previous = 0.0;
    for (const double h : {0.01, 0.005, 0.0025}) {
      const Eigen::Vector3d by_steps = turned(partly_turned(both, h), "ms").bottomRows<1>();
      const double off = (by_steps - exact).cwiseAbs().maxCoeff();
      CAPTURE(both, h, off);
      CHECK(off < 0.2 * h);
      if (previous > 0.0) CHECK(off / previous == Approx(0.5).margin(0.05));
      previous = off;
    }
  }
}

TEST_CASE("partly imposed rotation by ms: free components grow by what each step adds, as MBDyn counts them") {
  const Eigen::MatrixXd g = turned(partly_turned(true, 0.01), "ms");
  double free = 0.0, logarithm = 0.0, difference = 0.0;
  for (Eigen::Index k = 1; k < g.rows(); ++k) {
    const double t = 0.01 * static_cast<double>(k);
    const Mat3 R = rotation_exp(g.row(k));
    const auto left = [&](double counted) -> Vec3 {
      return rotation_log(R * rotation_exp(Vec3(imposed_x(t), imposed_y(t), counted)).transpose());
    };
    CHECK(left(free).head<2>().norm() < 1e-10);
    difference = std::max(difference, left(logarithm).head<2>().norm());
    free += left(free)(2);
    logarithm = g(k, 2);
  }
  CHECK(difference > 1e-6);  // the two ways of counting are told apart
}
