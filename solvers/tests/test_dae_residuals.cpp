// Residuals along motions that are proposed: true motions leave nothing, slopes are those of the linearised model and
// of finite differences, bad samples are refused.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include <limits>
#include <numbers>

#include "deck_builder.h"
#include "mbdae/dae/analyses.h"
#include "test_deck_support.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

// A body on a pin about z in the origin, m = 2 kg at 0.5 m, under gravity; unknowns: 12 and 5 reactions.
Deck swinging(double theta, double rate) {
  Deck deck;
  const Mat3 R = rotation_exp(Vec3(0, 0, theta));
  const Vec3 x = R * Vec3(0, -0.5, 0), w(0, 0, rate);
  const NodeIndex node = add_node(deck, NodeKind::dynamic_node, x, R, w.cross(x), w);
  add_body(deck, node, 2.0, Vec3(0.02, 0.03, 0.01), 0.03 * Mat3::Identity());
  add_joint(deck, RevolutePinData{node, Vec3(0, 0.5, 0), Mat3::Identity(), Vec3::Zero(), Mat3::Identity(), {}});
  add_gravity(deck, Vec3(0, -9.81, 0));
  return deck;
}

// Of `linearise` at (theta, rate) as a sample about its state at the reference.
Eigen::VectorXd sample_of(const LinearisedModel& at, const LinearisedModel& reference) {
  Eigen::VectorXd out(2 * at.y.size());
  out << at.y - reference.y, at.ydot - reference.ydot;
  const Mat3 turn = at.nodes[0].R * reference.nodes[0].R.transpose();
  const Vec3 g = cayley_parameters(turn);
  out.segment<3>(3) = g;
  out.segment<3>(at.y.size() + 3) = cayley_tangent(g).inverse() * (at.nodes[0].w - turn * reference.nodes[0].w);
  return out;
}

Deck loop_case(const std::string& name) {
  std::ifstream file(std::string(TEST_DATA_DIR) + "/mbdyn_loop/" + name + ".mbd");
  REQUIRE(file.good());
  std::ostringstream text;
  text << file.rdbuf();
  return deck_test::read_good(text.str());
}

Residuals residuals(const Deck& deck, const Eigen::VectorXd& samples, bool tangents) {
  return ResidualsAlong(deck)(samples, tangents ? 1 : 0);
}

}  // namespace

TEST_CASE("residuals: nothing is left of a pendulum in full swing, far from where it was linearised") {
  const Deck deck = swinging(0.3, 1.7);
  const LinearisedModel reference = linearise(deck, {});
  const double motions[][2] = {{0.3, 1.7}, {0.9, -2.0}, {-1.4, 3.0}, {2.6, 0.5}};
  Eigen::VectorXd samples(4 * 2 * 17);
  for (int k = 0; k < 4; ++k) {
    samples.segment<34>(34 * k) = sample_of(linearise(swinging(motions[k][0], motions[k][1]), {}), reference);
  }
  const Residuals found = residuals(deck, samples, false);
  REQUIRE(found.g.rows() == 17);
  REQUIRE(found.g.cols() == 4);
  CHECK(found.mean_g_y.size() == 0);
  for (int k = 0; k < 4; ++k) {
    INFO("sample " << k);
    CHECK(found.g.col(k).cwiseAbs().maxCoeff() < 1e-12);  // N, N m, m, rad
  }
  samples(34 + 8) += 0.1;  // momentum along z of the second
  CHECK(residuals(deck, samples, false).g.col(1).norm() > 0.05);
}

TEST_CASE("residuals: derivatives are those of the linearised model, and of finite differences far away") {
  const Deck pendulum = swinging(0.3, 1.7), closed = loop_case("g14_loop_gravity"), lugre = loop_case("g12_lugre");
  for (const Deck* deck : {&pendulum, &closed, &lugre}) {
    const LinearisedModel model = linearise(*deck, {});
    const Eigen::Index n = model.y.size();
    const Eigen::MatrixXd g_ydot = 0.5 * (model.J_plus + model.J_minus);
    const Eigen::MatrixXd g_y = (model.J_plus - model.J_minus) / (2.0 * model.c);
    const Residuals at_rest = residuals(*deck, Eigen::VectorXd::Zero(2 * n), true);
    CHECK(at_rest.g.cwiseAbs().maxCoeff() < 1e-8);
    CHECK((at_rest.mean_g_y - g_y).cwiseAbs().maxCoeff() < 1e-9 * (1.0 + g_y.cwiseAbs().maxCoeff()));
    CHECK((at_rest.mean_g_ydot - g_ydot).cwiseAbs().maxCoeff() < 1e-9 * (1.0 + g_ydot.cwiseAbs().maxCoeff()));

    Ugly ugly(7);
    Eigen::VectorXd far(2 * n);
    for (Eigen::Index k = 0; k < 2 * n; ++k) far(k) = ugly.number(-0.4, 0.4);
    const Residuals there = residuals(*deck, far, true);
    const double h = 1e-6;
    Eigen::VectorXd both(4 * n);
    for (Eigen::Index k = 0; k < 2 * n; ++k) {
      both << far, far;
      both(k) += h;
      both(2 * n + k) -= h;
      const Residuals ends = residuals(*deck, both, false);
      const Eigen::VectorXd slope = (ends.g.col(0) - ends.g.col(1)) / (2.0 * h);
      const Eigen::VectorXd told = k < n ? there.mean_g_y.col(k) : there.mean_g_ydot.col(k - n);
      INFO("unknown " << model.dofs[static_cast<std::size_t>(k % n)].name << (k < n ? "" : ", its rate"));
      CHECK((slope - told).norm() < 1e-6 * (1.0 + told.norm() + there.g.norm()));
    }
  }
}

TEST_CASE("residuals: averages of derivatives, and no memory between samples") {
  const Deck deck = loop_case("g14_loop_gravity");
  const Eigen::Index n = linearise(deck, {}).y.size();
  Ugly ugly(3);
  Eigen::VectorXd one(2 * n), other(2 * n), both(4 * n), swapped(4 * n);
  for (Eigen::Index k = 0; k < 2 * n; ++k) {
    one(k) = ugly.number(-0.3, 0.3);
    other(k) = ugly.number(-0.3, 0.3);
  }
  both << one, other;
  swapped << other, one;
  const Residuals a = residuals(deck, both, true), b = residuals(deck, swapped, true);
  const Residuals first = residuals(deck, one, true), second = residuals(deck, other, true);
  CHECK((a.g.col(0) - b.g.col(1)).norm() == 0.0);
  CHECK((a.g.col(0) - first.g).norm() == 0.0);
  CHECK((a.g.col(1) - second.g).norm() == 0.0);
  const Eigen::MatrixXd mean = 0.5 * (first.mean_g_y + second.mean_g_y);
  CHECK((a.mean_g_y - mean).cwiseAbs().maxCoeff() < 1e-12 * mean.cwiseAbs().maxCoeff());
}

TEST_CASE("residuals: harmonics are those of the samples they make") {
  const Deck deck = loop_case("g14_loop_gravity");
  const ResidualsAlong along(deck);
  const int instants = 24;
  const Eigen::Index n = linearise(deck, {}).y.size();
  Ugly ugly(11);
  Eigen::VectorXd motion(2 * n * 5);
  for (Eigen::Index k = 0; k < motion.size(); ++k) motion(k) = ugly.number(-0.1, 0.1);
  Eigen::VectorXd samples(2 * n * instants);
  for (int i = 0; i < instants; ++i) {
    const double t = 2.0 * std::numbers::pi * i / instants;
    for (Eigen::Index j = 0; j < 2 * n; ++j) {
      const auto c = motion.segment<5>(5 * j);
      samples(2 * n * i + j) =
          c(0) + c(1) * std::cos(t) - c(2) * std::sin(t) + c(3) * std::cos(2 * t) - c(4) * std::sin(2 * t);
    }
  }
  const Residuals found = along.of_harmonics(motion, 2, instants, 3), in_time = along(samples, 3);
  REQUIRE(found.g.rows() == n);
  REQUIRE(found.g.cols() == 5);
  CHECK((found.mean_g_y - in_time.mean_g_y).norm() < 1e-12 * in_time.mean_g_y.norm());
  CHECK((found.mean_g_ydot - in_time.mean_g_ydot).norm() < 1e-12 * in_time.mean_g_ydot.norm());
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(n, 5), g_y = Eigen::MatrixXd::Zero(n, n);
  for (int i = 0; i < instants; ++i) {
    const double t = 2.0 * std::numbers::pi * i / instants;
    const Eigen::VectorXd g = in_time.g.col(i) / instants;
    expected.col(0) += g;
    for (int k = 1; k < 3; ++k) {
      expected.col(2 * k - 1) += 2.0 * g * std::cos(k * t);
      expected.col(2 * k) -= 2.0 * g * std::sin(k * t);
    }
    if (i % 3 == 0) g_y += along(samples.segment(2 * n * i, 2 * n), 1).mean_g_y / 8.0;
  }
  CHECK((found.g - expected).norm() < 1e-12 * expected.norm());
  CHECK((found.mean_g_y - g_y).norm() < 1e-12 * g_y.norm());

  CHECK(along.of_harmonics(motion, 2, instants, 0).mean_g_y.size() == 0);
  CHECK_THROWS_WITH(along.of_harmonics(motion, 3, instants, 0), Catch::Contains("expected 2 x "));
  CHECK_THROWS_WITH(along.of_harmonics(motion, 2, 4, 0), "4 instants cannot tell 2 harmonics; give 5 or more");
  CHECK_THROWS_WITH(along.of_harmonics(motion, 2, 1 << 20, 0), Catch::Contains("are too many"));
  motion(5 * n) = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_WITH(along.of_harmonics(motion, 2, instants, 0), Catch::Contains("no finite rate in sample 1 of 24"));
}

TEST_CASE("residuals: bad samples and decks are refused by name") {
  const Deck deck = swinging(0.3, 0.0);
  const auto refusal = [](const Deck& of, const Eigen::VectorXd& samples) -> std::string {
    try {
      residuals(of, samples, false);
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  };
  CHECK(refusal(deck, Eigen::VectorXd::Zero(35)) ==
        "the samples are 35 numbers; expected rows of 2 x 17, y and ydot of the deck's unknowns");
  CHECK(refusal(deck, Eigen::VectorXd()) != "");
  Eigen::VectorXd samples = Eigen::VectorXd::Zero(68);
  samples(34 + 17 + 6) = std::numeric_limits<double>::quiet_NaN();
  CHECK(refusal(deck, samples) == "the samples have no finite rate in sample 2 of 2, node_1.bx");
  samples(34 + 17 + 6) = 0.0;
  samples(0) = std::numeric_limits<double>::infinity();
  CHECK(refusal(deck, samples) == "the samples have no finite value in sample 1 of 2, node_1.x");
  samples(0) = 0.0;
  samples(3) = 1e200;  // a rotation parameter whose square is too large
  CHECK_THROWS_AS(residuals(deck, samples, false), NotConverged);
  Deck fixed = swinging(0.3, 0.0);
  fixed.control.static_model = true;
  CHECK(refusal(fixed, samples).find("needs a dynamic deck") == std::string::npos);
  CHECK(refusal(fixed, samples).find("need a dynamic deck") != std::string::npos);
  const Deck coulomb = loop_case("g13_coulomb");
  CHECK(refusal(coulomb, Eigen::VectorXd::Zero(2)).find("sticks and slides") != std::string::npos);
}
