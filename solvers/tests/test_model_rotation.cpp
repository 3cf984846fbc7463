// Rotation maps against finite differences and identities, from tiny angles to pi.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include <Eigen/LU>

#include "deck_builder.h"
#include "mbdae/model/rotation.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

constexpr double kPi = 3.14159265358979323846;

// Fourth order central difference of a matrix or vector function along a line.
template <class F>
auto slope(const F& f) {
  const double h = 1e-3;
  using Value = decltype(f(0.0));
  const Value p1 = f(h), m1 = f(-h), p2 = f(2 * h), m2 = f(-2 * h);
  return Value((8.0 * (p1 - m1) - (p2 - m2)) / (12.0 * h));
}

Vec3 axial(const Mat3& m) { return 0.5 * Vec3(m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1)); }

std::vector<double> angles() { return {1e-12, 1e-7, 1e-4, 0.01, 0.3, 0.499, 0.501, 1.0, 2.0, 3.0, kPi - 1e-3}; }

}  // namespace

TEST_CASE("exponential and logarithm are inverse, also next to pi") {
  Ugly ugly(1);
  for (const double angle : {0.0, 1e-14, 1e-9, 1e-5, 0.1, 1.0, 3.0, kPi - 1e-6, kPi - 1e-12}) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 theta = angle * ugly.vector().normalized();
      const Mat3 R = rotation_exp(theta);
      CHECK((R * R.transpose() - Mat3::Identity()).norm() < 1e-15 * 10);
      INFO("angle " << angle);
      CHECK((rotation_log(R) - theta).norm() < 1e-15 + 3e-15 * angle);
    }
  }
  // exactly half a turn about each axis, where the sign of the axis is free
  for (int i = 0; i < 3; ++i) {
    const Mat3 R = rotation_exp(kPi * Vec3::Unit(i));
    CHECK(std::abs(rotation_log(R).norm() - kPi) < 1e-14);
    CHECK((rotation_exp(rotation_log(R)) - R).norm() < 1e-14);
  }
}

TEST_CASE("exponential against its power series") {
  const Vec3 theta(0.3, -0.5, 0.7);
  Mat3 term = Mat3::Identity(), sum = Mat3::Identity();
  for (int k = 1; k < 30; ++k) {
    term = (term * skew(theta) / k).eval();
    sum += term;
  }
  CHECK((rotation_exp(theta) - sum).norm() < 1e-15 * 5);
}

TEST_CASE("Gamma is the tangent of the exponential, its inverse that of the logarithm") {
  Ugly ugly(2);
  for (const double angle : angles()) {
    const Vec3 theta = angle * ugly.vector().normalized(), direction = ugly.vector();
    const Mat3 rate = slope([&](double h) { return rotation_exp(theta + h * direction); });
    const Vec3 spin = axial(rate * rotation_exp(theta).transpose());
    INFO("angle " << angle);
    CHECK((rotation_gamma(theta) * direction - spin).norm() < 1e-11);
    CHECK((rotation_gamma_inverse(theta) * rotation_gamma(theta) - Mat3::Identity()).norm() < 1e-13);
    const Mat3 R = rotation_exp(theta);
    if (angle < 3.0) {
      const Vec3 log_rate = slope([&](double h) { return rotation_log(rotation_exp(h * direction) * R); });
      CHECK((rotation_gamma_inverse(theta) * direction - log_rate).norm() < 1e-10);
    }
  }
}

TEST_CASE("derivatives of Gamma and of its inverse") {
  Ugly ugly(3);
  for (const double angle : angles()) {
    const Vec3 theta = angle * ugly.vector().normalized(), a = ugly.vector();
    const Mat3 by_theta = rotation_gamma_derivative(theta, a),
               inverse_by_theta = rotation_gamma_inverse_derivative(theta, a);
    for (int i = 0; i < 3; ++i) {
      const Vec3 e = Vec3::Unit(i);
      INFO("angle " << angle << " component " << i);
      CHECK((by_theta.col(i) - slope([&](double h) { return Vec3(rotation_gamma(theta + h * e) * a); })).norm() <
            1e-10);
      CHECK((inverse_by_theta.col(i) - slope([&](double h) {
               return Vec3(rotation_gamma_inverse(theta + h * e) * a);
             })).norm() < 1e-10);
    }
  }
}

TEST_CASE("Cayley-Gibbs-Rodrigues parameters") {
  Ugly ugly(4);
  for (const double size : {0.0, 1e-8, 0.1, 1.0, 10.0}) {
    const Vec3 g = size * ugly.vector(), direction = ugly.vector();
    const Mat3 R = cayley_rotation(g);
    CHECK((R * R.transpose() - Mat3::Identity()).norm() < 1e-14);
    CHECK((cayley_parameters(R) - g).norm() < 1e-13 * (1.0 + g.squaredNorm()));
    const Mat3 rate = slope([&](double h) { return cayley_rotation(g + h * direction); });
    CHECK((cayley_tangent(g) * direction - axial(rate * R.transpose())).norm() < 1e-10);
    // angle = 2 atan(|g| / 2) about g
    if (size > 0.0) {
      const Vec3 theta = 2.0 * std::atan(0.5 * g.norm()) * g.normalized();
      CHECK((rotation_exp(theta) - R).norm() < 1e-14);
    }
  }
}

TEST_CASE("quaternions of any rotation, every branch") {
  Ugly ugly(5);
  for (int i = 0; i < 200; ++i) {
    const Mat3 R = ugly.rotation(3.0);
    const Eigen::Vector4d q = quaternion_of(R);
    CHECK(q.norm() == Approx(1.0).epsilon(1e-15));
    CHECK(q(0) >= 0.0);
    CHECK((rotation_of_quaternion(q) - R).norm() < 1e-14);
    CHECK((rotation_of_quaternion(-2.7 * q) - R).norm() < 1e-14);
  }
}
