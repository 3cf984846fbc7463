// Time histories against closed forms, conserved quantities and the constraints themselves.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include <algorithm>

#include "deck_builder.h"
#include "mbdae/dae/analyses.h"
#include "mbdae/dae/multistep.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kGravity = 9.81;  // m/s^2

// Sanitizers take minutes over long motions, the end of which is the same code again.
#ifdef MBDAE_SANITIZED
constexpr bool kLong = false;
#else
constexpr bool kLong = true;
#endif

std::size_t column(const Motion& motion, const std::string& name) {
  for (std::size_t i = 0; i < motion.channels.size(); ++i) {
    if (motion.channels[i].name == name) return i;
  }
  FAIL("no channel " << name);
  return 0;
}

Eigen::VectorXd channel(const Motion& motion, const std::string& name) {
  return motion.data.col(static_cast<Eigen::Index>(column(motion, name)));
}

void set_time(Deck& deck, double final_time, double time_step) {
  deck.initial_value.final_time = final_time;
  deck.initial_value.time_step = time_step;
  deck.initial_value.tolerance = 1e-10;
}

// A rod of mass m [kg] whose centre is L [m] from a hinge at the origin with axis z, hanging along -y, displaced by
// theta.
Deck pendulum(double theta, double m = 2.0, double L = 0.5, double J = 0.03) {
  Deck deck;
  const Mat3 R = rotation_exp(Vec3(0.0, 0.0, theta));
  const NodeIndex node = add_node(deck, NodeKind::dynamic_node, R * Vec3(0.0, -L, 0.0), R);
  add_body(deck, node, m, Vec3::Zero(), Vec3(0.01, 0.005, J).asDiagonal());
  RevolutePinData pin;
  pin.node = node;
  pin.d = Vec3(0.0, L, 0.0);
  pin.Rh = pin.R0 = Mat3::Identity();
  pin.X0 = Vec3::Zero();
  add_joint(deck, pin);
  add_gravity(deck, Vec3(0.0, -kGravity, 0.0));
  return deck;
}

double pendulum_frequency(double m = 2.0, double L = 0.5, double J = 0.03) {
  return std::sqrt(m * kGravity * L / (J + m * L * L));  // rad/s, small motion
}

// Times of upward zero crossings by cubic interpolation through value and rate.
std::vector<double> upward_crossings(const Motion& motion, const Eigen::VectorXd& value, const Eigen::VectorXd& rate) {
  std::vector<double> out;
  for (Eigen::Index i = 0; i + 1 < value.size(); ++i) {
    if (!(value(i) < 0.0 && value(i + 1) >= 0.0)) continue;
    const double h = motion.time[static_cast<std::size_t>(i) + 1] - motion.time[static_cast<std::size_t>(i)];
    const auto cubic = [&](double s) {
      return (1 + 2 * s) * (1 - s) * (1 - s) * value(i) + s * (1 - s) * (1 - s) * h * rate(i) +
             s * s * (3 - 2 * s) * value(i + 1) + s * s * (s - 1) * h * rate(i + 1);
    };
    double low = 0.0, high = 1.0;
    for (int k = 0; k < 60; ++k) (cubic(0.5 * (low + high)) < 0.0 ? low : high) = 0.5 * (low + high);
    out.push_back(motion.time[static_cast<std::size_t>(i)] + low * h);
  }
  return out;
}

// Complete elliptic integral of the first kind, modulus k, by the arithmetic-geometric mean.
double elliptic_K(double k) {
  double a = 1.0, b = std::sqrt(1.0 - k * k);
  while (std::abs(a - b) > 1e-15) {
    const double mean = 0.5 * (a + b);
    b = std::sqrt(a * b);
    a = mean;
  }
  return kPi / (2.0 * a);
}

double period_of(const Motion& motion) {
  const std::vector<double> crossings =
      upward_crossings(motion, channel(motion, "node_1.gz"), channel(motion, "node_1.wz"));
  REQUIRE(crossings.size() >= 3);
  return (crossings.back() - crossings.front()) / static_cast<double>(crossings.size() - 1);
}

IntegrateOptions with(const std::string& integrator, double rtol = 1e-8, double atol = 1e-10) {
  IntegrateOptions options;
  options.integrator = integrator;
  options.rtol = rtol;
  options.atol = atol;
  return options;
}

// Kinetic energy and potential energy in gravity -y of bodies with their centre of mass in the node [J].
Eigen::VectorXd energy(const Deck& deck, const Motion& motion) {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(motion.time.size()));
  for (const BodyData& body : deck.bodies) {
    const std::string& name = deck.nodes[body.node].id.name;
    for (Eigen::Index i = 0; i < out.size(); ++i) {
      const auto vector = [&](const char* suffix) {
        const std::size_t first = column(motion, name + suffix);
        return Vec3(motion.data.block<1, 3>(i, static_cast<Eigen::Index>(first)).transpose());
      };
      const Mat3 R = rotation_exp(vector(".gx"));
      const Vec3 v = vector(".vx"), w = R.transpose() * vector(".wx");
      out(i) += 0.5 * body.m * v.squaredNorm() + 0.5 * w.dot(body.J_cm * w) + body.m * kGravity * vector(".x").y();
    }
  }
  return out;
}

double relative_error(double value, double expected) { return std::abs(value / expected - 1.0); }

double spread(const Eigen::VectorXd& v) { return v.maxCoeff() - v.minCoeff(); }

}  // namespace

TEST_CASE("small pendulum: frequency of both integrators") {
  const double amplitude = 1e-4;
  Deck deck = pendulum(amplitude);
  const double expected = 2.0 * kPi / pendulum_frequency();
  set_time(deck, 5.5 * expected, 1e-3);
  CHECK(relative_error(period_of(integrate(deck, with("ida", 1e-10, 1e-13))), expected) < 1e-8);
  deck.initial_value.rho = 1.0;
  deck.initial_value.tolerance = 1e-13;
  CHECK(relative_error(period_of(integrate(deck, with("ms"))), expected) < 1e-5);  // of order (w h)^2 / 12
}

TEST_CASE("large pendulum: period by the elliptic integral") {
  for (const double amplitude : {0.5, 1.5, 3.0}) {
    Deck deck = pendulum(amplitude);
    const double expected = 4.0 / pendulum_frequency() * elliptic_K(std::sin(0.5 * amplitude));
    set_time(deck, 4.5 * expected, 2e-3);
    INFO("amplitude " << amplitude);
    CHECK(relative_error(period_of(integrate(deck, with("ida", 1e-10, 1e-12))), expected) < 1e-6);
  }
}

TEST_CASE("ms converges with the square of the time step") {
  const double amplitude = 1.0, expected = 4.0 / pendulum_frequency() * elliptic_K(std::sin(0.5 * amplitude));
  double errors[2];
  for (int i = 0; i < 2; ++i) {
    Deck deck = pendulum(amplitude);
    set_time(deck, 3.5 * expected, i == 0 ? 4e-3 : 2e-3);
    errors[i] = period_of(integrate(deck, with("ms"))) / expected - 1.0;
  }
  CHECK(errors[0] / errors[1] == Approx(4.0).epsilon(0.05));
  CHECK(std::abs(errors[1]) < 1e-4);
}

TEST_CASE("coefficients of the two-step formula") {
  for (const double rho : {0.0, 0.3, 0.6, 1.0}) {
    const MultistepCoefficients m = multistep_coefficients(rho);
    // exact for y = 1, t, t^2 about t_k = 0 with h = 1
    CHECK(std::abs(m.a1 + m.a2 - 1.0) < 1e-14);
    CHECK(std::abs(-m.a1 - 2.0 * m.a2 + m.b0 + m.b1 + m.b2) < 1e-14);
    CHECK(std::abs(m.a1 + 4.0 * m.a2 - 2.0 * m.b1 - 4.0 * m.b2) < 1e-14);
    // roots of b0 z^2 + b1 z + b2 both at -rho
    CHECK(std::abs(m.b1 / m.b0 - 2.0 * rho) < 1e-14);
    CHECK(std::abs(m.b2 / m.b0 - rho * rho) < 1e-14);
  }
  CHECK(relative_error(multistep_coefficients(0.0).a1, 4.0 / 3.0) < 1e-14);  // BDF2
}

TEST_CASE("mass, spring and damper: free decay") {
  const double m = 2.0, k = 300.0, c = 4.0, L0 = 1.0, x0 = 0.01;
  for (const char* integrator : {"ida", "ms"}) {
    Deck deck;
    const NodeIndex ground = add_node(deck, NodeKind::static_node, Vec3::Zero());
    const NodeIndex mass = add_node(deck, NodeKind::dynamic_node, Vec3(L0 + x0, 0.0, 0.0));
    add_body(deck, mass, m, Vec3::Zero(), 0.1 * Mat3::Identity());
    add_joint(deck, clamp(deck, ground));
    LinearLaw<1> law;
    law.K << k * L0;
    law.C << c * L0;
    add_joint(deck, RodData{ground, mass, Vec3::Zero(), Vec3::Zero(), L0, law});
    deck.initial_value.rho = 0.6;
    set_time(deck, 2.0, 5e-4);
    const Motion motion = integrate(deck, with(integrator, 1e-10, 1e-13));
    const Eigen::VectorXd x = channel(motion, "node_2.x");
    const double zeta = c / (2.0 * std::sqrt(k * m)), w0 = std::sqrt(k / m), wd = w0 * std::sqrt(1.0 - zeta * zeta);
    double error = 0.0;
    for (std::size_t i = 0; i < motion.time.size(); ++i) {
      const double t = motion.time[i];
      const double exact = x0 * std::exp(-zeta * w0 * t) * (std::cos(wd * t) + zeta * w0 / wd * std::sin(wd * t));
      error = std::max(error, std::abs(x(static_cast<Eigen::Index>(i)) - L0 - exact));
    }
    INFO(integrator);
    CHECK(error / x0 < (std::string(integrator) == "ida" ? 1e-7 : 1e-4));
  }
}

TEST_CASE("fast top: steady precession and conserved angular momentum") {
  // Symmetric top about a fixed point under gravity -y, axis inclined by theta to the vertical, no nutation:
  // J1 Omega^2 cos(theta) - J3 Omega p + m g l = 0 for spin p of the body about its axis (total).
  const double m = 1.5, l = 0.2, J3 = 0.01, J1_cm = 0.008, theta = 0.6, Omega = 2.0;
  const double J1 = J1_cm + m * l * l;
  const double p = (J1 * Omega * Omega * std::cos(theta) + m * kGravity * l) / (J3 * Omega);
  const Mat3 R = rotation_exp(Vec3(0.0, 0.0, theta));  // axis e = R e_y
  const Vec3 e = R.col(1), up(0.0, 1.0, 0.0);
  const Vec3 w = p * e + Omega * (up - up.dot(e) * e);
  Deck deck;
  const NodeIndex node = add_node(deck, NodeKind::dynamic_node, l * e, R, w.cross(l * e), w);
  add_body(deck, node, m, Vec3::Zero(), Vec3(J1_cm, J3, J1_cm).asDiagonal());
  add_joint(deck, SphericalPinData{node, Vec3(0.0, -l, 0.0), Vec3::Zero()});
  add_gravity(deck, Vec3(0.0, -kGravity, 0.0));
  set_time(deck, 1.0, 0.01);
  const Motion motion = integrate(deck, with("ida", 1e-10, 1e-12));
  const Eigen::VectorXd x = channel(motion, "node_1.x"), y = channel(motion, "node_1.y"),
                        z = channel(motion, "node_1.z");
  double error = 0.0;  // m
  for (std::size_t i = 0; i < motion.time.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const Vec3 expected = rotation_exp(Vec3(0.0, Omega * motion.time[i], 0.0)) * (l * e);
    error = std::max(error, (Vec3(x(k), y(k), z(k)) - expected).norm());
  }
  CHECK(error / l < 1e-8);
}

TEST_CASE("slider-crank: kinematics of a driven crank") {
  // Crank of radius r about z at the origin, driven in rotation; coupler of length L; slider on the x axis.
  const double r = 0.1, L = 0.35, phi0 = 0.3, amplitude = 2.0, omega = 3.0;
  const auto drive = sine(0.0, amplitude, omega);  // crank angle beyond phi0, starts at rate amplitude * omega
  const double rate0 = amplitude * omega, s = r * std::sin(phi0), c = std::sqrt(L * L - s * s);
  const Vec3 pin(r * std::cos(phi0), s, 0.0), wc(0.0, 0.0, rate0);
  const double beta = std::asin(s / L), beta_rate = r * std::cos(phi0) * rate0 / c;  // coupler angle below the x axis
  const Vec3 slider(pin.x() + c, 0.0, 0.0), w2(0.0, 0.0, -beta_rate);
  Deck deck;
  const Mat3 Rc = rotation_exp(Vec3(0.0, 0.0, phi0)), Rb = rotation_exp(Vec3(0.0, 0.0, -beta));
  const NodeIndex crank = add_node(deck, NodeKind::dynamic_node, Vec3::Zero(), Rc, Vec3::Zero(), wc);
  const Vec3 v2 = wc.cross(pin);
  const NodeIndex coupler = add_node(deck, NodeKind::dynamic_node, pin, Rb, v2, w2);
  const Vec3 v3 = v2 + w2.cross(slider - pin);
  const NodeIndex block = add_node(deck, NodeKind::dynamic_node, slider, Mat3::Identity(), v3);
  for (const NodeIndex node : {crank, coupler, block}) {
    add_body(deck, node, 0.5, Vec3(0.01, 0.02, 0.0), 0.01 * Mat3::Identity());
  }
  TotalPinData drive_pin;
  drive_pin.node = crank;
  drive_pin.fn = drive_pin.Xc = Vec3::Zero();
  drive_pin.Rnh = drive_pin.Rnhr = drive_pin.Rch = Mat3::Identity();
  drive_pin.Rnhr = Rc.transpose();
  drive_pin.Rchr = Mat3::Identity();
  drive_pin.position.fill(TotalComponent::position);
  drive_pin.rotation.fill(TotalComponent::position);
  drive_pin.rotation_drive = vector_drive<3>(Vec3(0.0, 0.0, 1.0), drive);
  add_joint(deck, drive_pin);
  add_joint(deck,
            RevoluteHingeData{crank, coupler, Vec3(r, 0, 0), Vec3::Zero(), Mat3::Identity(), Mat3::Identity(), {}, {}});
  add_joint(deck, SphericalHingeData{coupler, block, Vec3(L, 0, 0), Vec3::Zero()});
  TotalPinData guide = drive_pin;
  guide.node = block;
  guide.Rnhr = Mat3::Identity();
  guide.Xc = Vec3::Zero();
  // the slider's height follows from the planar chain; its travel is free, its rotation is not
  guide.position = {TotalComponent::inactive, TotalComponent::position, TotalComponent::inactive};
  guide.rotation_drive = {};
  add_joint(deck, guide);
  add_gravity(deck, Vec3(0.0, -kGravity, 0.0));
  set_time(deck, 1.0, 5e-3);
  for (const char* integrator : {"ida", "ms"}) {
    const bool ida = std::string(integrator) == "ida";
    if (!ida) deck.initial_value.time_step = 1e-3;
    const Motion motion = integrate(deck, with(integrator, 1e-9, 1e-11));
    const Eigen::VectorXd x = channel(motion, "node_3.x"), v = channel(motion, "node_3.vx");
    double error = 0.0, rate_error = 0.0;  // m, m/s
    for (std::size_t i = 0; i < motion.time.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const Jet jet = drive->at(motion.time[i]);
      const double phi = phi0 + jet.value, sine_part = r * std::sin(phi),
                   side = std::sqrt(L * L - sine_part * sine_part);
      const double x_exact = r * std::cos(phi) + side;
      const double v_exact = -jet.rate * (sine_part + sine_part * r * std::cos(phi) / side);
      error = std::max(error, std::abs(x(k) - x_exact));
      rate_error = std::max(rate_error, std::abs(v(k) - v_exact));
    }
    INFO(integrator);
    CHECK(error < 1e-13);
    CHECK(rate_error < (ida ? 1e-13 : 1e-4));
  }
}

TEST_CASE("double pendulum: energy over 10 s") {
  constexpr double kDuration = kLong ? 10.0 : 1.0;  // s
  Deck deck = pendulum(2.0);
  const Mat3 R = rotation_exp(Vec3(0.0, 0.0, 1.2));
  const Vec3 joint = deck.nodes[0].x + deck.nodes[0].R * Vec3(0.0, -0.5, 0.0);
  const NodeIndex second = add_node(deck, NodeKind::dynamic_node, joint - R * Vec3(0.0, 0.4, 0.0), R);
  add_body(deck, second, 1.0, Vec3::Zero(), Vec3(0.01, 0.002, 0.02).asDiagonal());
  add_joint(deck, RevoluteHingeData{
                      0, second, Vec3(0, -0.5, 0), Vec3(0, 0.4, 0), Mat3::Identity(), Mat3::Identity(), {}, {}});
  set_time(deck, kDuration, 0.02);
  const Motion motion = integrate(deck, with("ida", 1e-12, 1e-14));
  const Eigen::VectorXd total = energy(deck, motion);
  const double scale = 3.0 * kGravity;  // J, about the energy to be exchanged
  CHECK(spread(total) / scale < 1e-8);
}

TEST_CASE("constraints hold for 1000 s") {
  constexpr double kDuration = kLong ? 1000.0 : 20.0;  // s
  Deck deck = pendulum(1.0);
  set_time(deck, kDuration, 0.05);
  const Motion motion = integrate(deck, with("ida"));
  const Eigen::Index n = static_cast<Eigen::Index>(motion.time.size());
  const Eigen::Index x = static_cast<Eigen::Index>(column(motion, "node_1.x"));
  double position = 0.0, velocity = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = [&](int offset) { return Vec3(motion.data.block<1, 3>(i, x + offset).transpose()); };
    const Vec3 arm = rotation_exp(at(3)) * Vec3(0.0, 0.5, 0.0);
    position = std::max(position, (at(0) + arm).norm());
    velocity = std::max(velocity, (at(6) + at(9).cross(arm)).norm());
  }
  CHECK(position < 1e-13);  // m
  CHECK(velocity < 1e-13);  // m/s
}
