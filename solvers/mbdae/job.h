// One task on one deck: what the command line and the serve mode have in common.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/deck/reader.h"
#include "mbdae/output/matrices_file.h"

namespace mbdae {

/// Name and version, `mbdae 1.0.0`.
std::string program_version();

enum class Task {
  automatic,  ///< what the deck asks for: static, linearise (eigenanalysis card) or integrate
  check,
  static_equilibrium,
  linearise,
  integrate,
  residuals
};

/// The options of the command line; the serve mode takes the same ones by the same names.
struct JobOptions {
  std::optional<double> c;            ///< [s]
  std::optional<std::string> state;   ///< matrices file whose `y` is imposed
  std::optional<double> tolerance;    ///< of the static equilibrium
  std::optional<int> max_iterations;  ///< of the static equilibrium
  std::optional<std::string> integrator;
  std::optional<double> rtol, atol;
  std::optional<double> final_time, time_step;  ///< [s]
  std::optional<int> every;                     ///< time steps between rows
  std::vector<std::string> channels;
  std::optional<std::string> samples;  ///< file of the motion whose residuals are wanted
  std::optional<int> harmonics;        ///< with residuals: the file has that many harmonics of a period
  std::optional<int> instants;         ///< with harmonics: samples of the period
  bool tangents = false;               ///< with residuals: their mean derivatives too
  std::optional<int> tangents_every;   ///< with tangents: samples from one derivative to the next
  bool layout = false;                 ///< with check: list the unknowns
  bool nodes = true;                   ///< tell where the nodes are

  /// Name of an option that only a time integration uses, or nullptr when none was given.
  const char* integration_option() const;
  /// The same for linearisation (`c`, `state`), the static equilibrium and residuals.
  const char* linearisation_option() const;
  const char* static_option() const;
  const char* residuals_option() const;
};

struct Job {
  Task task = Task::automatic;
  std::string deck;                 ///< path; with `text` only the name used in messages and for includes
  std::optional<std::string> text;  ///< the deck's text
  /// File to write, or with `output_is_prefix` what precedes `.h5` (matrices) and `.motion.h5`. Empty = write nothing.
  std::string output;
  bool output_is_prefix = false;
  JobOptions options;
  std::function<void(double)> progress;  ///< of the time integration, with the time reached [s]; may be empty
};

enum class Status { ok, deck_error, not_converged, io_error, bad_request, internal_error };

const char* status_name(Status status);

/// 0 ok, 2 not converged, 1 everything else.
int exit_code(Status status);

/// What became of a job.
struct Outcome {
  Status status = Status::ok;
  std::string message;
  std::vector<Diagnostic> diagnostics;
  std::string analysis;  ///< check, static, linearise, integrate or residuals
  int iterations = 0;
  double residual_norm = 0.0;
  double seconds = 0.0;
  std::vector<NodeState> nodes;
  std::vector<UnknownInfo> dofs;                     ///< with JobOptions::layout
  std::vector<std::pair<std::string, long>> counts;  ///< of what the deck or the result holds, in a fixed order
  std::string output;                                ///< the file written, empty if none
  std::vector<DatasetPlace> datasets;                ///< where they lie in a matrices file that was written
  std::vector<std::string> more_outputs;             ///< of further times of the eigenanalysis
};

/// Does the job. Never throws on bad input: everything that goes wrong is told in the outcome.
Outcome run_job(const Job& job);

}  // namespace mbdae
