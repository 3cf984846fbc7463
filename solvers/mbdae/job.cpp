// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/job.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/elements/table.h"
#include "mbdae/output/hdf5_file.h"
#include "mbdae/output/matrices_file.h"
#include "mbdae/output/motion_file.h"
#include "mbdae/output/provenance.h"

namespace mbdae {

namespace fs = std::filesystem;

namespace {

/// A deck or a file of samples larger than this is something else [bytes].
constexpr std::size_t kLargestFile = 256u << 20;

/// The job asks for something that cannot be done with this deck, or with these options.
class BadRequest : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The bytes of a regular file; `what` it is, for messages.
std::string read_whole_file(const std::string& path, const char* what = "deck") {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a FIFO without a writer would block
  if (fd < 0) throw FileError("cannot read '" + path + "': " + std::strerror(errno));
  struct stat status {};
  if (::fstat(fd, &status) == 0 && !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode)) {
    ::close(fd);
    throw FileError("cannot read '" + path + "': it is a " +
                    (S_ISFIFO(status.st_mode) ? "FIFO" : "device or a socket") + ", a " + what + " is a regular file");
  }
  std::string text;
  char buffer[65536];
  ssize_t count = 0;
  while ((count = ::read(fd, buffer, sizeof buffer)) != 0) {
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      const int error = errno;
      ::close(fd);
      throw FileError("cannot read '" + path + "': " + std::strerror(error));
    }
    text.append(buffer, static_cast<std::size_t>(count));
    if (text.size() > kLargestFile) {
      ::close(fd);
      throw FileError("'" + path + "' is larger than 256 MB: this is not a " + what);
    }
  }
  ::close(fd);
  return text;
}

/// SHA-256 of the deck's text followed by its includes in order of appearance.
std::string deck_hash(const std::string& text, const Deck& deck) {
  if (deck.files.size() < 2) return sha256_hex(text);
  std::string all = text;
  for (std::size_t i = 1; i < deck.files.size(); ++i) all += read_whole_file(deck.files[i]);
  return sha256_hex(all);
}

/// Refuses an output whose directory cannot take it before any time is spent on the analysis.
void check_output_directory(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  const std::string directory = parent.empty() ? "." : parent.string();
  struct stat status {};
  if (::lstat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    const char* const what = S_ISLNK(status.st_mode)    ? "a symbolic link"
                             : S_ISDIR(status.st_mode)  ? "a directory"
                             : S_ISFIFO(status.st_mode) ? "a FIFO"
                                                        : "a device or a socket";
    throw FileError("cannot write '" + path + "': it is " + what + "; results are written to regular files only");
  }
  const std::string inside = directory + "/.";  // so that a plain file is refused, too
  const int error = ::access(inside.c_str(), W_OK) == 0 ? 0 : errno;
  if (error != 0) {
    throw FileError("cannot write '" + path + "': directory '" + directory + "': " + std::strerror(error));
  }
}

std::vector<std::pair<std::string, long>> count_deck(const Deck& deck) {
  std::map<std::string, long> elements;
  for (const std::vector<ElementData>* list : {&deck.joints, &deck.genels, &deck.forces}) {
    for (const ElementData& element : *list) {
      ++elements[element.type->counts != nullptr ? element.type->counts(element.data) : element.type->counts_as];
    }
  }
  std::vector<std::pair<std::string, long>> counts = {{"nodes", static_cast<long>(deck.nodes.size())},
                                                      {"dummy_nodes", static_cast<long>(deck.dummy_nodes.size())},
                                                      {"bodies", static_cast<long>(deck.bodies.size())}};
  for (const char* kind : {"joints", "deformable", "rods", "muscles", "forces"}) {
    counts.emplace_back(kind, elements[kind]);
  }
  if (!deck.abstract_nodes.empty()) {
    counts.emplace_back("abstract_nodes", static_cast<long>(deck.abstract_nodes.size()));
  }
  if (!deck.genels.empty()) counts.emplace_back("genels", elements["genels"]);
  return counts;
}

Task task_of_deck(const Deck& deck) {
  if (deck.control.static_model) return Task::static_equilibrium;
  return deck.initial_value.eigenanalysis ? Task::linearise : Task::integrate;
}

const char* analysis_name(Task task) {
  switch (task) {
    case Task::static_equilibrium:
      return "static";
    case Task::linearise:
      return "linearise";
    case Task::integrate:
      return "integrate";
    case Task::residuals:
      return "residuals";
    default:
      return "check";
  }
}

void refuse_unused_options(Task task, const JobOptions& options) {
  const std::string doing = std::string("; this job's analysis is '") + analysis_name(task) + "'";
  if (const char* name = options.integration_option(); name && task != Task::integrate) {
    throw BadRequest(std::string("option '") + name + "' belongs to a time integration" + doing);
  }
  if (const char* name = options.linearisation_option(); name && task != Task::linearise) {
    throw BadRequest(std::string("option '") + name + "' belongs to a linearisation" + doing);
  }
  if (const char* name = options.static_option(); name && task != Task::static_equilibrium) {
    throw BadRequest(std::string("option '") + name + "' belongs to a static equilibrium" + doing);
  }
  if (const char* name = options.residuals_option(); name && task != Task::residuals) {
    throw BadRequest(std::string("option '") + name + "' belongs to residuals" + doing);
  }
  if (options.harmonics.has_value() != options.instants.has_value()) {
    throw BadRequest(std::string("option '") + (options.harmonics ? "harmonics" : "instants") + "' wants '" +
                     (options.harmonics ? "instants" : "harmonics") + "' too");
  }
  if (options.tangents_every && !options.tangents) throw BadRequest("option 'tangents_every' wants 'tangents' too");
  if (options.layout && task != Task::check) throw BadRequest("option 'layout' belongs to a check" + doing);
}

/// A result with a NaN or an infinity is no result: says where the first one is.
void require_finite(const LinearisedModel& model) {
  const auto name = [&](Eigen::Index i) { return model.dofs.at(static_cast<std::size_t>(i)).name; };
  const std::pair<const char*, const Eigen::VectorXd*> vectors[] = {
      {"the unknown", &model.y}, {"the rate of", &model.ydot}, {"the residual of", &model.residual}};
  for (const auto& [what, vector] : vectors) {
    for (Eigen::Index i = 0; i < vector->size(); ++i) {
      if (!std::isfinite((*vector)(i)))
        throw NotConverged(std::string(what) + " " + name(i) + " has no finite value: " + kLookForNoNumber);
    }
  }
  const std::pair<const char*, const Eigen::MatrixXd*> matrices[] = {{"J(c)", &model.J_plus},
                                                                     {"J(-c)", &model.J_minus}};
  for (const auto& [what, matrix] : matrices) {
    if (all_finite(matrix->data(), matrix->size())) continue;
    for (Eigen::Index col = 0; col < matrix->cols(); ++col) {
      for (Eigen::Index row = 0; row < matrix->rows(); ++row) {
        if (!std::isfinite((*matrix)(row, col))) {
          throw NotConverged(std::string(what) + " is not finite in the equation of " + name(row) +
                             ", derivative with respect to " + name(col));
        }
      }
    }
  }
}

std::string output_path(const Job& job, Task task) {
  if (job.output.empty() || !job.output_is_prefix) return job.output;
  return job.output + (task == Task::integrate ? ".motion.h5" : ".h5");
}

std::vector<LinearisedModel> solve(Task task, const Deck& deck, const JobOptions& given) {
  if (task == Task::static_equilibrium) {
    if (!deck.control.static_model) {
      throw ModelError("a static equilibrium needs 'model: static' in the control data block");
    }
    StaticOptions options;
    if (given.tolerance) options.tolerance = *given.tolerance;
    if (given.max_iterations) options.max_iterations = *given.max_iterations;
    std::vector<LinearisedModel> models;
    models.push_back(solve_static(deck, options));
    return models;
  }
  LineariseOptions options;
  options.c = given.c;
  if (given.state) {  // taken as the state at the initial time, and no other
    options.state = read_state(*given.state);
    std::vector<LinearisedModel> models;
    models.push_back(linearise(deck, options));
    return models;
  }
  return linearise_at_times(deck, options);
}

Motion integrate_deck(const Deck& deck, const Job& job, Integration& integration) {
  IntegrateOptions options;
  const JobOptions& given = job.options;
  if (given.integrator) options.integrator = *given.integrator;
  if (given.rtol) options.rtol = *given.rtol;
  if (given.atol) options.atol = *given.atol;
  options.final_time = given.final_time;
  options.time_step = given.time_step;
  if (given.every) options.output_every = *given.every;
  options.channels = given.channels;
  options.progress = job.progress;
  integration = {options.integrator, options.rtol, options.atol};
  return integrate(deck, options);
}

/// The deck whose residuals were asked for last: a balance asks for those of one deck some hundred times, and reading
/// it takes as long as everything else. Files that it reads are read again and compared.
struct KeptDeck {
  KeptDeck(std::string its_name, std::string its_text, Deck its_deck)
      : name(std::move(its_name)), text(std::move(its_text)), deck(std::move(its_deck)), residuals(deck) {
    for (std::size_t i = 1; i < deck.files.size(); ++i) others.push_back(read_whole_file(deck.files[i]));
  }

  bool is(const std::string& other_name, const std::string& other_text) const {
    if (other_text != text || (!others.empty() && other_name != name)) return false;  // others lie beside the deck
    try {
      for (std::size_t i = 0; i < others.size(); ++i) {
        if (read_whole_file(deck.files[i + 1]) != others[i]) return false;
      }
    } catch (const FileError&) {
      return false;  // reading the deck says what is the matter
    }
    return true;
  }

  std::string name, text;
  Deck deck;
  std::vector<std::string> others;
  ResidualsAlong residuals;
};
std::unique_ptr<const KeptDeck> kept_deck;

/// Residuals along a file of samples; both are plain 64-bit numbers in the machine's order.
void write_residuals(const ResidualsAlong& along, const Job& job, Outcome& outcome) {
  const std::string output = output_path(job, Task::residuals);
  if (!output.empty()) check_output_directory(output);
  if (!job.options.samples) throw BadRequest("residuals need option 'samples', the file of a motion");
  const std::string bytes = read_whole_file(*job.options.samples, "file of samples");
  if (bytes.size() % sizeof(double) != 0) {
    throw BadRequest("'" + *job.options.samples + "' has " + std::to_string(bytes.size()) +
                     " bytes; expected whole 64-bit numbers");
  }
  Eigen::VectorXd samples(static_cast<Eigen::Index>(bytes.size() / sizeof(double)));
  if (!bytes.empty()) std::memcpy(samples.data(), bytes.data(), bytes.size());
  Residuals found;
  try {
    const int every = job.options.tangents ? job.options.tangents_every.value_or(1) : 0;
    found = job.options.harmonics
                ? along.of_harmonics(samples, *job.options.harmonics, job.options.instants.value_or(0), every)
                : along(samples, every);
  } catch (const std::invalid_argument& error) {
    throw BadRequest("'" + *job.options.samples + "': " + error.what());
  }
  const long rows = static_cast<long>(found.g.rows()), columns = static_cast<long>(found.g.cols());
  outcome.counts = {{"unknowns", rows}, {"samples", job.options.instants ? *job.options.instants : columns}};
  outcome.output = output;
  if (output.empty()) return;
  if (job.options.harmonics) found.g.transposeInPlace();
  std::vector<double> numbers;  // a row per sample, or per unknown of harmonics; then the matrices row by row
  numbers.reserve(static_cast<std::size_t>(found.g.size() + 2 * found.mean_g_y.size()));
  numbers.insert(numbers.end(), found.g.data(), found.g.data() + found.g.size());
  for (const Eigen::MatrixXd* matrix : {&found.mean_g_y, &found.mean_g_ydot}) {
    const Eigen::MatrixXd rows = matrix->transpose();
    numbers.insert(numbers.end(), rows.data(), rows.data() + rows.size());
  }
  const char* const first = reinterpret_cast<const char*>(numbers.data());
  write_file(output, std::span(first, numbers.size() * sizeof(double)));
}

/// Adds notes that are not there yet as warnings.
void warn(const std::vector<std::string>& notes, const std::string& deck, Outcome& outcome) {
  for (const std::string& note : notes) {
    Diagnostic diagnostic;
    diagnostic.file = deck;
    diagnostic.severity = Severity::warning;
    diagnostic.message = note;
    const auto same = [&](const Diagnostic& other) { return other.message == note; };
    if (std::none_of(outcome.diagnostics.begin(), outcome.diagnostics.end(), same)) {
      outcome.diagnostics.push_back(std::move(diagnostic));
    }
  }
}

/// `pilot.h5`, `pilot_01.h5`, `pilot_02.h5`, ... for the models of one deck.
std::string numbered(const std::string& path, std::size_t index) {
  if (index == 0) return path;
  fs::path out(path);
  const std::string number = (index < 10 ? "_0" : "_") + std::to_string(index);
  out.replace_filename(out.stem().string() + number + out.extension().string());
  return out.string();
}

void analyse(const Job& job, Task task, const std::string& text, const Deck& deck, Outcome& outcome) {
  const std::string output = output_path(job, task);
  if (!output.empty()) check_output_directory(output);
  const auto provenance = [&] { return Provenance{program_version(), deck_hash(text, deck)}; };

  if (task == Task::integrate) {
    Integration integration;
    const Motion motion = integrate_deck(deck, job, integration);
    outcome.counts = {{"rows", static_cast<long>(motion.time.size())},
                      {"channels", static_cast<long>(motion.channels.size())}};
    warn(motion.notes, job.deck, outcome);
    if (!output.empty()) write_motion_file(output, motion, integration, provenance());
  } else {
    std::vector<LinearisedModel> models = solve(task, deck, job.options);
    for (const LinearisedModel& model : models) {
      require_finite(model);
      warn(model.notes, job.deck, outcome);
    }
    LinearisedModel& model = models.front();
    outcome.iterations = model.iterations;
    outcome.residual_norm = model.residual_norm;
    outcome.counts = {{"unknowns", static_cast<long>(model.y.size())},
                      {"inputs", static_cast<long>(model.inputs.size())},
                      {"muscles", static_cast<long>(model.muscles.size())}};
    if (!output.empty()) {
      for (std::size_t i = 0; i < models.size(); ++i) {
        const std::string path = numbered(output, i);
        std::vector<DatasetPlace> places = write_matrices_file(path, models[i], provenance());
        if (i == 0) {
          outcome.datasets = std::move(places);
        } else {
          outcome.more_outputs.push_back(path);
        }
      }
    }
    if (job.options.nodes) outcome.nodes = std::move(model.nodes);
  }
  outcome.output = output;
}

/// The work of run_job without its edge.
void run(const Job& job, Outcome& outcome) {
  const std::string text = job.text ? *job.text : read_whole_file(job.deck);
  if (job.task == Task::residuals && kept_deck && kept_deck->is(job.deck, text)) {
    outcome.analysis = analysis_name(job.task);
    refuse_unused_options(job.task, job.options);
    return write_residuals(kept_deck->residuals, job, outcome);
  }
  ReadResult read = read_deck_text(text, job.deck);
  outcome.diagnostics = std::move(read.diagnostics);
  if (!read.deck) {
    outcome.status = Status::deck_error;
    outcome.message = "the deck cannot be read";
    for (const Diagnostic& diagnostic : outcome.diagnostics) {
      if (diagnostic.severity == Severity::error) {
        outcome.message = diagnostic.format();
        break;
      }
    }
    return;
  }
  Deck& deck = *read.deck;
  const Task task = job.task == Task::automatic ? task_of_deck(deck) : job.task;
  outcome.analysis = analysis_name(task);
  refuse_unused_options(task, job.options);
  if (task == Task::check) {
    outcome.counts = count_deck(deck);
    if (job.options.layout) {
      outcome.dofs = linearise(deck, LineariseOptions{}).dofs;
      outcome.counts.emplace_back("unknowns", static_cast<long>(outcome.dofs.size()));
    }
    return;
  }
  if (task == Task::residuals) {
    kept_deck.reset();
    auto ready = std::make_unique<const KeptDeck>(job.deck, text, std::move(deck));
    write_residuals(ready->residuals, job, outcome);
    if (outcome.diagnostics.empty()) kept_deck = std::move(ready);
    return;
  }
  analyse(job, task, text, deck, outcome);
}

}  // namespace

std::string program_version() { return "mbdae " MBDAE_VERSION; }

const char* JobOptions::integration_option() const {
  if (integrator) return "integrator";
  if (rtol) return "rtol";
  if (atol) return "atol";
  if (final_time) return "final_time";
  if (time_step) return "time_step";
  if (every) return "every";
  return channels.empty() ? nullptr : "channels";
}

const char* JobOptions::linearisation_option() const { return c ? "c" : state ? "state" : nullptr; }

const char* JobOptions::static_option() const {
  return tolerance ? "tolerance" : max_iterations ? "max_iterations" : nullptr;
}

const char* JobOptions::residuals_option() const {
  if (samples) return "samples";
  if (harmonics) return "harmonics";
  if (instants) return "instants";
  if (tangents_every) return "tangents_every";
  return tangents ? "tangents" : nullptr;
}

const char* status_name(Status status) {
  switch (status) {
    case Status::ok:
      return "ok";
    case Status::deck_error:
      return "deck_error";
    case Status::not_converged:
      return "not_converged";
    case Status::io_error:
      return "io_error";
    case Status::bad_request:
      return "bad_request";
    case Status::internal_error:
      break;
  }
  return "internal_error";
}

int exit_code(Status status) { return status == Status::ok ? 0 : status == Status::not_converged ? 2 : 1; }

Outcome run_job(const Job& job) {
  const auto start = std::chrono::steady_clock::now();
  Outcome outcome;
  const auto fail = [&](Status status, const std::string& message) {
    outcome.status = status;
    outcome.message = message;
  };
  try {
    run(job, outcome);
  } catch (const NotConverged& error) {
    fail(Status::not_converged, job.deck + ": " + error.what());
  } catch (const ModelError& error) {
    Diagnostic diagnostic;
    diagnostic.file = job.deck;
    diagnostic.message = error.what();
    fail(Status::deck_error, diagnostic.format());
    outcome.diagnostics.push_back(std::move(diagnostic));
  } catch (const FileError& error) {
    fail(Status::io_error, error.what());
  } catch (const BadRequest& error) {
    fail(Status::bad_request, error.what());
  } catch (const std::bad_alloc&) {
    fail(Status::internal_error, job.deck + ": out of memory");
  } catch (const std::exception& error) {
    fail(Status::internal_error, job.deck + ": unexpected: " + error.what());
  }
  outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return outcome;
}

}  // namespace mbdae
