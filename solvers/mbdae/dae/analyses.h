// The analyses: a Deck in, results out.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/deck/deck.h"

namespace mbdae {

/// An analysis did not converge. The message names the node or joint and equation with the largest residual.
class NotConverged : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What to do about an equation without a finite value; ends a message.
inline constexpr const char* kLookForNoNumber =
    "look for a drive without a value there (a root, logarithm or division), or for a number that is too large";

/// The deck asks for something that the mechanics cannot do (message for a person).
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct StaticOptions {
  double tolerance = 1e-10;  ///< 2-norm of the equilibrium residual, scaled [N, N m, m, rad]
  int max_iterations = 50;
  int load_steps = 16;  ///< of the fallback when Newton with line search fails
};

struct LineariseOptions {
  std::optional<double> c;  ///< [s]; default: the deck's `parameter` / 2, 0.01 without an eigenanalysis card
  /// State to impose before linearising, instead of the one the deck implies: full y vector (positions and rotations
  /// entries ignored, momenta and reactions used). For comparison with files of other programs.
  std::optional<Eigen::VectorXd> state;
};

struct IntegrateOptions {
  std::string integrator = "ida";  ///< "ida" or "ms"
  double rtol = 1e-8, atol = 1e-10;
  std::optional<double> final_time, time_step;  ///< override the deck's
  int output_every = 1;                         ///< time steps between rows
  std::vector<std::string> channels;            ///< empty = all
  std::function<void(double)> progress;         ///< called with the time reached; may be empty
};

struct State;
/// Called with the state at every instant written; false ends the integration.
using AtInstant = std::function<bool(const State&)>;

/// Number of whole time steps from the initial to the final time. Throws ModelError if they are too many to write.
long count_steps(const InitialValueData& settings);

/// Static equilibrium of a `model: static` deck, linearised there.
LinearisedModel solve_static(const Deck& deck, const StaticOptions& options);

/// The deck's state with consistent momenta, accelerations and reactions, linearised.
LinearisedModel linearise(const Deck& deck, const LineariseOptions& options);

/// What is left of the equations along a motion that somebody proposes.
struct Residuals {
  Eigen::MatrixXd g;                      ///< one column per sample
  Eigen::MatrixXd mean_g_y, mean_g_ydot;  ///< derivatives, averages over samples; empty unless asked for
};

/// A deck made ready for residuals along many motions near the state that `linearise` takes, at the deck's initial
/// time. Throws ModelError on a static deck and on elements that remember (stuck, sliding). The deck must outlive it.
class ResidualsAlong {
 public:
  explicit ResidualsAlong(const Deck& deck);
  ~ResidualsAlong();

  /// `samples` has rows of 2 n numbers one after the other: the unknowns less those of that state (rotations:
  /// Cayley-Gibbs-Rodrigues parameters from its orientations), then their rates less its rates, both in the order of
  /// files. Derivatives are those of every so many samples, from the first (0: none). Throws std::invalid_argument on
  /// samples of another size or not finite, NotConverged where a residual is not finite.
  Residuals operator()(const Eigen::VectorXd& samples, int tangents_every) const;

  /// The same along a periodic motion given by its harmonics, at instants equally spaced over a period. `harmonics` has
  /// 2 K + 1 numbers for every unknown, then as many for every rate: the mean, then real and imaginary parts of c_k,
  /// for mean + Re sum c_k exp(j k t); `g` gets 2 K + 1 columns, those of the residuals. Throws std::invalid_argument
  /// on numbers of another size and fewer than 2 K + 1 instants, too.
  Residuals of_harmonics(const Eigen::VectorXd& harmonics, int count, int instants, int tangents_every) const;

 private:
  struct Prepared;
  std::unique_ptr<const Prepared> prepared_;
};

/// The deck linearised at every time of its eigenanalysis card: at the initial state, the others on the way by the
/// deck's integration method (IDA where there is none here). Times in one step give one model; times beyond the end
/// give one there.
std::vector<LinearisedModel> linearise_at_times(const Deck& deck, const LineariseOptions& options);

/// Time history from the deck's state.
Motion integrate(const Deck& deck, const IntegrateOptions& options);

}  // namespace mbdae
