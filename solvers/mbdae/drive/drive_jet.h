// Arithmetic on jets: values that carry their first and second time derivative through every operation (chain rule).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <numbers>

#include "mbdae/drive/drive.h"

namespace mbdae {

/// f(x) given f, f' and f'' at x.value. A constant argument stays constant even where f has no derivative.
inline Jet compose(const Jet& x, double f, double f1, double f2) {
  Jet out{f, 0.0, 0.0};
  if (x.rate != 0.0) {
    out.rate = f1 * x.rate;
    out.second = f2 * x.rate * x.rate;
  }
  if (x.second != 0.0) out.second += f1 * x.second;
  return out;
}

inline Jet operator-(const Jet& a) { return {-a.value, -a.rate, -a.second}; }
inline Jet operator+(const Jet& a, const Jet& b) { return {a.value + b.value, a.rate + b.rate, a.second + b.second}; }
inline Jet operator-(const Jet& a, const Jet& b) { return {a.value - b.value, a.rate - b.rate, a.second - b.second}; }
inline Jet operator*(const Jet& a, const Jet& b) {
  return {a.value * b.value, a.rate * b.value + a.value * b.rate,
          a.second * b.value + 2.0 * a.rate * b.rate + a.value * b.second};
}
inline Jet operator/(const Jet& a, const Jet& b) {
  const double q = a.value / b.value;
  const double q1 = (a.rate - q * b.rate) / b.value;
  return {q, q1, (a.second - 2.0 * q1 * b.rate - q * b.second) / b.value};
}

inline Jet exp(const Jet& x) {
  const double f = std::exp(x.value);
  return compose(x, f, f, f);
}
inline Jet log(const Jet& x) { return compose(x, std::log(x.value), 1.0 / x.value, -1.0 / (x.value * x.value)); }
inline Jet log10(const Jet& x) {
  const Jet natural = log(x);
  const double k = 1.0 / std::numbers::ln10;
  return {std::log10(x.value), k * natural.rate, k * natural.second};
}
inline Jet sqrt(const Jet& x) {
  const double f = std::sqrt(x.value);
  return compose(x, f, 0.5 / f, -0.25 / (f * x.value));
}
inline Jet sin(const Jet& x) {
  const double s = std::sin(x.value), c = std::cos(x.value);
  return compose(x, s, c, -s);
}
inline Jet cos(const Jet& x) {
  const double s = std::sin(x.value), c = std::cos(x.value);
  return compose(x, c, -s, -c);
}
inline Jet tan(const Jet& x) {
  const double t = std::tan(x.value), d = 1.0 + t * t;
  return compose(x, t, d, 2.0 * t * d);
}
inline Jet asin(const Jet& x) {
  const double d = 1.0 / std::sqrt(1.0 - x.value * x.value);
  return compose(x, std::asin(x.value), d, x.value * d * d * d);
}
inline Jet acos(const Jet& x) {
  const double d = 1.0 / std::sqrt(1.0 - x.value * x.value);
  return compose(x, std::acos(x.value), -d, -x.value * d * d * d);
}
inline Jet atan(const Jet& x) {
  const double d = 1.0 / (1.0 + x.value * x.value);
  return compose(x, std::atan(x.value), d, -2.0 * x.value * d * d);
}
inline Jet sinh(const Jet& x) {
  const double s = std::sinh(x.value), c = std::cosh(x.value);
  return compose(x, s, c, s);
}
inline Jet cosh(const Jet& x) {
  const double s = std::sinh(x.value), c = std::cosh(x.value);
  return compose(x, c, s, c);
}
inline Jet tanh(const Jet& x) {
  const double t = std::tanh(x.value), d = 1.0 - t * t;
  return compose(x, t, d, -2.0 * t * d);
}
inline Jet asinh(const Jet& x) {
  const double d = 1.0 / std::sqrt(x.value * x.value + 1.0);
  return compose(x, std::asinh(x.value), d, -x.value * d * d * d);
}
inline Jet acosh(const Jet& x) {
  const double d = 1.0 / std::sqrt(x.value * x.value - 1.0);
  return compose(x, std::acosh(x.value), d, -x.value * d * d * d);
}
inline Jet atanh(const Jet& x) {
  const double d = 1.0 / (1.0 - x.value * x.value);
  return compose(x, std::atanh(x.value), d, 2.0 * x.value * d * d);
}

/// The angle of the point (x, y).
inline Jet atan2(const Jet& y, const Jet& x) {
  const double d = x.value * x.value + y.value * y.value;
  const double n = x.value * y.rate - y.value * x.rate;
  const double n1 = x.value * y.second - y.value * x.second;
  const double d1 = 2.0 * (x.value * x.rate + y.value * y.rate);
  if (n == 0.0 && n1 == 0.0) return {std::atan2(y.value, x.value), 0.0, 0.0};
  return {std::atan2(y.value, x.value), n / d, (n1 * d - n * d1) / (d * d)};
}

/// x^y. With a constant exponent also for negative x (integer exponents) and at x = 0.
inline Jet pow(const Jet& x, const Jet& y) {
  const double f = std::pow(x.value, y.value);
  if (y.rate == 0.0 && y.second == 0.0) {
    const double n = y.value;
    const double f1 = n == 0.0 ? 0.0 : n * std::pow(x.value, n - 1.0);
    const double f2 = n == 0.0 || n == 1.0 ? 0.0 : n * (n - 1.0) * std::pow(x.value, n - 2.0);
    return compose(x, f, f1, f2);
  }
  const Jet out = exp(y * log(x));
  return {f, out.rate, out.second};
}

/// Which branch of a function with a kink at zero holds just after now: +1, -1, or 0 (stays at zero).
inline int side(const Jet& x) {
  for (const double part : {x.value, x.rate, x.second}) {
    if (part > 0.0) return 1;
    if (part < 0.0) return -1;
  }
  return 0;
}

inline Jet fabs(const Jet& x) { return side(x) < 0 ? -x : x; }
inline Jet copysign(const Jet& x, const Jet& y) {
  const Jet magnitude = fabs(x);
  return std::signbit(y.value) ? -magnitude : magnitude;
}

}  // namespace mbdae
