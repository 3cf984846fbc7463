// Drives: values by hand, derivatives against finite differences.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <numbers>

#include "test_deck_support.h"

using mbdae::DrivePtr;
using mbdae::Jet;

namespace {

/// The drive as the magnitude of a couple about x.
DrivePtr drive(const std::string& text, const std::string& globals = "") {
  deck_test::DeckText deck;
  deck.globals = globals;
  deck.elements = "couple: 1, absolute, 1, 1., 0., 0., " + text + ";\n";
  const mbdae::Deck read = deck_test::read_good(deck);
  REQUIRE(read.forces[0].as<mbdae::ForceData>().value.terms.size() == 1);
  return read.forces[0].as<mbdae::ForceData>().value.terms[0].drive;
}

/// Rate and second derivative against central differences of the value (4th order).
void check_derivatives(const std::string& text, double from, double to) {
  INFO(text);
  const DrivePtr d = drive(text);
  const double h = 1e-3;
  for (int i = 0; i <= 20; ++i) {
    const double t = from + (to - from) * i / 20.0;
    const double p1 = d->value(t + h), m1 = d->value(t - h), p2 = d->value(t + 2 * h), m2 = d->value(t - 2 * h);
    const Jet jet = d->at(t);
    INFO("t = " << t);
    CHECK(jet.rate == Approx((8 * (p1 - m1) - (p2 - m2)) / (12 * h)).epsilon(1e-7).margin(1e-9));
    CHECK(jet.second ==
          Approx((16 * (p1 + m1) - (p2 + m2) - 30 * jet.value) / (12 * h * h)).epsilon(1e-6).margin(1e-7));
  }
}

void check_jet(const DrivePtr& d, double t, double value, double rate, double second) {
  INFO("t = " << t);
  const Jet jet = d->at(t);
  CHECK(jet.value == Approx(value).epsilon(1e-14).margin(1e-14));
  CHECK(jet.rate == Approx(rate).epsilon(1e-14).margin(1e-14));
  CHECK(jet.second == Approx(second).epsilon(1e-13).margin(1e-13));
}

}  // namespace

TEST_CASE("constants") {
  check_jet(drive("3."), 1.0, 3.0, 0.0, 0.0);
  check_jet(drive("const, 3."), 1.0, 3.0, 0.0, 0.0);
  check_jet(drive("null"), 1.0, 0.0, 0.0, 0.0);
  check_jet(drive("unit"), 1.0, 1.0, 0.0, 0.0);
  check_jet(drive("one"), 1.0, 1.0, 0.0, 0.0);
  check_jet(drive("timestep"), 1.0, 1.0, 1.0, 0.0);  // within a vector: its argument
  check_jet(drive("time"), 1.5, 1.5, 1.0, 0.0);
  check_jet(drive("direct"), 1.5, 1.5, 1.0, 0.0);
}

TEST_CASE("the time step is a number, but the time within other drives") {
  deck_test::DeckText deck;
  deck.globals =
      "module load: \"libmodule-muscles\"; drive caller: 1, timestep; drive caller: 2, mult, timestep, reference, 1;\n"
      "drive caller: 3, array, 2, timestep, 1., output, yes;\n";
  deck.elements =
      "joint: 1, rod, 1, 2, 1., muscle, reference length, 1., reference force, 1., activation, reference, 1, "
      "reflexive, "
      "proportional gain, reference, 2, derivative gain, reference, 3, reference length, timestep;\n";
  const mbdae::Deck read = deck_test::read_good(deck);
  const auto& rod = read.joints[0].as<mbdae::RodData>();
  const auto& law = std::get<mbdae::MuscleLaw>(rod.law);
  check_jet(law.activation, 3.0, 0.01, 0.0, 0.0);
  check_jet(law.reflex->proportional_gain, 3.0, 9.0, 6.0, 2.0);
  check_jet(law.reflex->derivative_gain, 3.0, 4.0, 1.0, 0.0);
  check_jet(law.reflex->reference_length, 3.0, 0.01, 0.0, 0.0);
}

TEST_CASE("ramp and step") {
  const DrivePtr ramp = drive("ramp, 2., 1., 3., 0.5");
  check_jet(ramp, 0.9, 0.5, 0.0, 0.0);
  check_jet(ramp, 1.0, 0.5, 2.0, 0.0);
  check_jet(ramp, 2.0, 2.5, 2.0, 0.0);
  check_jet(ramp, 3.0, 4.5, 0.0, 0.0);
  check_jet(ramp, 9.0, 4.5, 0.0, 0.0);
  check_jet(drive("ramp, 2., 1., forever, 0.5"), 101.0, 200.5, 2.0, 0.0);
  const DrivePtr step = drive("step, 1., 3., 0.25");
  check_jet(step, 0.999, 0.25, 0.0, 0.0);
  check_jet(step, 1.0, 1.625, 0.0, 0.0);
  check_jet(step, 1.001, 3.25, 0.0, 0.0);
}

TEST_CASE("sine and cosine stop where they should") {
  const double w = 4.0, period = 2.0 * std::numbers::pi / w, A = 2.0;
  const DrivePtr sine = drive("sine, 1., 4., 2., forever, 0.5");
  check_jet(sine, 0.5, 0.5, 0.0, 0.0);
  check_jet(sine, 1.0, 0.5, A * w, 0.0);
  check_jet(sine, 1.0 + 0.3, 0.5 + A * std::sin(1.2), A * w * std::cos(1.2), -A * w * w * std::sin(1.2));
  check_jet(drive("sine, 1., 4., 2., half, 0.5"), 1.0 + period, 0.5 + A, 0.0, 0.0);
  check_jet(drive("sine, 1., 4., 2., one, 0.5"), 1.0 + 0.51 * period, 0.5, 0.0, 0.0);
  check_jet(drive("sine, 1., 4., 2., one, 0.5"), 1.0 + 0.49 * period, 0.5 + A * std::sin(0.98 * std::numbers::pi),
            A * w * std::cos(0.98 * std::numbers::pi), -A * w * w * std::sin(0.98 * std::numbers::pi));
  check_jet(drive("sine, 1., 4., 2., 3, 0.5"), 1.0 + 2.51 * period, 0.5, 0.0, 0.0);
  check_jet(drive("sine, 1., 4., 2., 3, 0.5"), 1.0 + 2.25 * period, 0.5 + A, 0.0, -A * w * w);
  const DrivePtr cosine = drive("cosine, 1., 4., 2., forever, 0.5");
  check_jet(cosine, 0.5, 0.5, 0.0, 0.0);
  check_jet(cosine, 1.0, 0.5, 0.0, A * w * w);
  check_jet(cosine, 1.3, 0.5 + A * (1.0 - std::cos(1.2)), A * w * std::sin(1.2), A * w * w * std::cos(1.2));
  check_jet(drive("cosine, 1., 4., 2., half, 0.5"), 1.0 + period, 0.5 + 2.0 * A, 0.0, 0.0);
  check_jet(drive("sine, 1., 4., 2., -1, 0.5"), 1.0 + period, 0.5 + A, 0.0, 0.0);
  check_jet(drive("sine, 1., 4., 2., -3, 0.5"), 1.0 + 2.2 * period, 0.5 + A * std::sin(4.4 * std::numbers::pi),
            A * w * std::cos(4.4 * std::numbers::pi), -A * w * w * std::sin(4.4 * std::numbers::pi));
  check_jet(drive("sine, 1., 4., 2., -3, 0.5"), 1.0 + 2.3 * period, 0.5 + A, 0.0, 0.0);
  check_jet(drive("cosine, 1., 4., 2., -2, 0.5"), 1.0 + 1.6 * period, 0.5 + 2.0 * A, 0.0, 0.0);
  check_jet(drive("cosine, 1., 4., 2., one, 0.5"), 1.0 + 1.1 * period, 0.5, 0.0, 0.0);
  check_jet(drive("cosine, 1., 4., 2., 2, 0.5"), 1.0 + 1.5 * period, 0.5 + 2.0 * A, 0.0, -A * w * w);
  check_jet(drive("cosine, 1., 4., 2., 2, 0.5"), 1.0 + 2.1 * period, 0.5, 0.0, 0.0);
}

TEST_CASE("string drives are exact jets") {
  check_jet(drive("string, \"3*Time^2 + 2*Var\""), 2.0, 16.0, 14.0, 6.0);
  check_jet(drive("string, \"1/3*Time\""), 2.0, 0.0, 0.0, 0.0);  // an integer division
  check_jet(drive("string, \"TimeStep*Time\""), 2.0, 0.02, 0.01, 0.0);
  check_jet(drive("string, \" sin ( 2. * Time ) \""), 0.3, std::sin(0.6), 2.0 * std::cos(0.6), -4.0 * std::sin(0.6));
  check_jet(drive("string, \"real A = 2.*Time; A*A\""), 3.0, 36.0, 24.0, 8.0);
  check_jet(drive("string, \"integer I = 2; I = I + 1; I*Time;\""), 2.0, 6.0, 3.0, 0.0);
  check_jet(drive("string, \"(Time >= 1.)*(Time - 1.)\""), 3.0, 2.0, 1.0, 0.0);
  check_jet(drive("string, \"abs(Time)\""), -2.0, 2.0, -1.0, 0.0);
  check_jet(drive("string, \"max(Time, 1.)\""), 1.0, 1.0, 1.0, 0.0);
  check_jet(drive("string, \"Time^0.5\""), 4.0, 2.0, 0.25, -0.03125);
  // Variables are looked up when the drive is evaluated.
  check_jet(drive("string, \"A*Time\"", "set: real A = 1.; set: A = 3.;"), 2.0, 6.0, 3.0, 0.0);
  const Jet nothing = drive("string, \"1./(Time - 5.)\"")->at(5.0);
  CHECK(std::isnan(nothing.value));
}

TEST_CASE("derivatives of everything a string may hold agree with finite differences") {
  for (const char* text : {"exp(-Time)*sin(3.*Time)",
                           "sqrt(1. + Time^2)",
                           "log(2. + Time)/(1. + Time)",
                           "log10(2. + Time)",
                           "tan(0.5*Time)",
                           "asin(0.4*Time)",
                           "acos(0.4*Time)",
                           "atan(2.*Time)",
                           "sinh(Time)",
                           "cosh(Time)",
                           "tanh(2.*Time)",
                           "asinh(Time)",
                           "acosh(2. + Time)",
                           "atanh(0.4*Time)",
                           "atan2(Time, 1. + Time^2)",
                           "actan(2. + Time)",
                           "actan2(1. + Time, 2.)",
                           "ctan(1. + 0.5*Time)",
                           "ctanh(1. + Time)",
                           "actanh(2. + Time)",
                           "(2. + Time)^Time",
                           "(2. + Time)^3",
                           "2.^Time",
                           "-Time^3",
                           "copysign(Time + 1., -1.)",
                           "par(Time + 0.5)",
                           "max(sin(Time), 2.)*Time"}) {
    check_derivatives(std::string("string, \"") + text + "\"", 0.1, 1.4);
  }
  check_derivatives("sine, 0., 4., 2., forever, 0.5", 0.1, 2.0);
  check_derivatives("cosine, 0., 4., 2., forever, 0.5", 0.1, 2.0);
  check_derivatives("mult, sine, 0., 4., 2., forever, 0.5, mult, time, cosine, 0., 3., 1., forever, 0.", 0.1, 2.0);
  check_derivatives("array, 3, sine, 0., 4., 2., forever, 0.5, string, \"Time^3\", 2.", 0.1, 2.0);
}

TEST_CASE("named drives") {
  const DrivePtr d =
      drive("array, 2, reference, FIRST, reference, 2",
            "set: const integer FIRST = 1; drive caller: FIRST, time; drive caller: 2, name, \"two\", const, 2.;");
  check_jet(d, 3.0, 5.0, 1.0, 0.0);
}

TEST_CASE("vector drives") {
  using mbdae::Vec3;
  const auto force = [](const std::string& text, const std::string& frame = "absolute") {
    deck_test::DeckText deck;
    deck.nodes = "structural: 1, dynamic, null, euler, degrees, 0., 0., 90., null, null;\n";
    deck.globals = "reference: 5, null, euler, degrees, 90., 0., 0., null, null;\n";
    deck.elements = "force: 1, " + frame + ", 1, position, null, " + text + ";\n";
    return deck_test::read_good(deck).forces[0].as<mbdae::ForceData>().value;
  };
  CHECK(force("null").at(1.0) == Vec3::Zero());
  CHECK(force("1., 2., 3., time").at(2.0) == Vec3(2, 4, 6));
  CHECK(force("single, 1., 2., 3., time").at(2.0, 1) == Vec3(1, 2, 3));
  CHECK(force("component, time, inactive, string, \"Time^2\"").at(3.0) == Vec3(3, 0, 9));
  CHECK(force("component, time, inactive, string, \"Time^2\"").at(3.0, 2) == Vec3(0, 0, 2));
  CHECK(force("array, 2, 1., 0., 0., time, 1., 2., 3., one").at(4.0) == Vec3(5, 2, 3));
  CHECK(force("zero").at(1.0) == Vec3::Zero());
  const double close = 1e-15;
  CHECK((force("single, reference, 5, 0., 1., 0., 1.").at(0.0) - Vec3(0, 0, 1)).norm() < close);
  CHECK((force("single, reference, global, 0., 1., 0., 1.", "follower").at(0.0) - Vec3(1, 0, 0)).norm() < close);
  CHECK((force("single, reference, node, 0., 1., 0., 1.", "follower").at(0.0) - Vec3(0, 1, 0)).norm() < close);
}
