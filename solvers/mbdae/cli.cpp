// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/cli.h"

#include <sys/time.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <string>

#include "mbdae/job.h"
#include "mbdae/reply.h"
#include "mbdae/serve.h"

namespace mbdae {

namespace {

constexpr const char* kDescription =
    "mbdae reads an MBDyn-style deck and finds its static equilibrium, linearises it or integrates it in time.\n"
    "\n"
    "What is done follows from the deck: 'model: static' asks for the static equilibrium, an 'eigenanalysis' card\n"
    "for the linearised model, anything else for a time history.";

constexpr const char* kFooter =
    "files written:\n"
    "  PREFIX.h5         linearised model (static equilibrium, linearisation): docs/io_formats/matrices.md\n"
    "  PREFIX.motion.h5  time history: docs/io_formats/motion.md\n"
    "\n"
    "exit code: 0 done; 1 error in the deck, the command line or a file; 2 not converged\n"
    "\n"
    "examples:\n"
    "  mbdae pilot.mbd -o results/pilot          linearised model in results/pilot.h5\n"
    "  mbdae --check pilot.mbd                   read the deck and say what is in it\n"
    "  mbdae pilot.mbd --integrate --final-time 2 --channels lever.gz,hand_l.y -o results/pilot\n"
    "  mbdae --serve                             one JSON request per line: docs/io_formats/serve.md";

/// CLI11's own check for a positive number prints the largest double with all its digits.
const CLI::Validator kPositive(
    [](std::string& text) {
      char* end = nullptr;
      const double value = std::strtod(text.c_str(), &end);
      return end == text.c_str() || !(value > 0.0) || std::isinf(value)
                 ? "must be a number greater than zero, not " + text
                 : std::string();
    },
    "> 0");

struct Arguments {
  std::string deck, prefix;
  bool check = false, integrate = false, serve = false, json = false, quiet = false;
  int parent = 0;
  JobOptions options;
};

void declare(CLI::App& app, Arguments& arguments) {
  JobOptions& options = arguments.options;
  app.set_version_flag("--version", program_version());
  app.footer(kFooter);
  app.add_option("DECK", arguments.deck, "the deck to read");
  app.add_option("-o,--output", arguments.prefix,
                 "prefix of the files to write, or a directory (default: DECK without its extension)")
      ->type_name("PREFIX");
  app.add_flag("--check", arguments.check, "only read the deck and say what is in it");
  app.add_flag("--layout", options.layout, "with --check: list the unknowns")->needs("--check");
  app.add_flag("--json", arguments.json, "print the outcome as one line of JSON (the reply of the serve mode)");
  app.add_flag("-q,--quiet", arguments.quiet, "print nothing but errors");

  const std::string linearisation = "linearisation";
  app.add_option("-c,--coefficient", options.c, "coefficient c of J(c), J(-c) instead of the deck's [s]")
      ->check(kPositive)
      ->group(linearisation);
  app.add_option("--state", options.state, "matrices file whose momenta and reactions (dataset y) are imposed")
      ->type_name("FILE")
      ->group(linearisation);

  const std::string equilibrium = "static equilibrium";
  app.add_option("--tolerance", options.tolerance, "2-norm of the scaled residual to reach")
      ->check(kPositive)
      ->group(equilibrium);
  app.add_option("--max-iterations", options.max_iterations, "Newton iterations allowed")
      ->check(kPositive)
      ->group(equilibrium);

  const std::string integration = "time integration";
  app.add_flag("--integrate", arguments.integrate, "integrate in time even if the deck has an eigenanalysis card")
      ->excludes("--check")
      ->group(integration);
  app.add_option("--integrator", options.integrator,
                 "ida (variable step) or ms (the deck's multistep method, fixed step); default ida")
      ->check(CLI::IsMember({"ida", "ms"}))
      ->group(integration);
  app.add_option("--rtol", options.rtol, "relative tolerance of ida; default 1e-8")
      ->check(kPositive)
      ->group(integration);
  app.add_option("--atol", options.atol, "absolute tolerance of ida; default 1e-10")
      ->check(kPositive)
      ->group(integration);
  app.add_option("--final-time", options.final_time, "instead of the deck's [s]")->group(integration);
  app.add_option("--time-step", options.time_step, "instead of the deck's [s]")->check(kPositive)->group(integration);
  app.add_option("--every", options.every, "time steps between rows; default 1")->check(kPositive)->group(integration);
  app.add_option("--channels", options.channels, "channels to write, separated by commas; default all")
      ->delimiter(',')
      ->group(integration);

  CLI::Option* serve = app.add_flag("--serve", arguments.serve, "answer requests on standard input until it ends");
  serve->group("serve mode");
  app.add_option("--exit-with-parent", arguments.parent, "with --serve: end when process PID is no longer the parent")
      ->type_name("PID")
      ->check(kPositive)
      ->needs(serve)
      ->group("serve mode");
}

// ---- serve mode --------------------------------------------------------------------------------------------------

volatile std::sig_atomic_t parent_pid = 0;

void end_without_parent(int) {
  if (::getppid() != parent_pid) ::_exit(1);
}

/// Looks once a second whether the parent lives: it may die while a long analysis runs, which would not see the end of
/// input. (PR_SET_PDEATHSIG would also fire when only the parent's thread ends.)
void watch_parent(int pid) {
  parent_pid = pid;
  struct sigaction action {};
  action.sa_handler = end_without_parent;
  action.sa_flags = SA_RESTART;
  ::sigaction(SIGALRM, &action, nullptr);
  itimerval interval{};
  interval.it_value.tv_sec = interval.it_interval.tv_sec = 1;
  ::setitimer(ITIMER_REAL, &interval, nullptr);
}

// ---- one deck ----------------------------------------------------------------------------------------------------

std::string counted(const Outcome& outcome) {
  std::string text;
  for (const auto& [name, count] : outcome.counts) {
    std::string words = name;
    for (char& letter : words) {
      if (letter == '_') letter = ' ';
    }
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + words;
  }
  return text;
}

void print_layout(const Outcome& outcome) {
  std::size_t width = 4;
  for (const UnknownInfo& dof : outcome.dofs) width = std::max(width, dof.name.size());
  std::printf("%5s  %-*s  %-14s  %-8s  %s\n", "index", static_cast<int>(width), "name", "kind", "unit", "owner");
  for (std::size_t i = 0; i < outcome.dofs.size(); ++i) {
    const UnknownInfo& dof = outcome.dofs[i];
    std::printf("%5zu  %-*s  %-14s  %-8s  %d\n", i, static_cast<int>(width), dof.name.c_str(), dof.kind.c_str(),
                dof.unit.c_str(), dof.owner);
  }
}

void print_summary(const std::string& deck, const Outcome& outcome) {
  std::printf("%s: %s: %s\n", deck.c_str(), outcome.analysis.c_str(), counted(outcome).c_str());
  if (outcome.analysis == "static") {
    std::printf("equilibrium after %d iterations, residual %.3g\n", outcome.iterations, outcome.residual_norm);
  } else if (outcome.analysis == "linearise") {
    std::printf("residual %.3g\n", outcome.residual_norm);
  }
  if (!outcome.dofs.empty()) print_layout(outcome);
  if (!outcome.output.empty()) std::printf("wrote %s in %.3g s\n", outcome.output.c_str(), outcome.seconds);
  for (const std::string& path : outcome.more_outputs) std::printf("wrote %s\n", path.c_str());
}

/// Prints the time reached on standard error, at most every tenth of a second of wall clock.
std::function<void(double)> progress_line() {
  return [last = std::chrono::steady_clock::time_point{}](double time) mutable {
    const auto now = std::chrono::steady_clock::now();
    if (now - last < std::chrono::milliseconds(100)) return;
    last = now;
    std::fprintf(stderr, "\rt = %.4g s ", time);
  };
}

/// The given prefix; in a directory, and without one, the deck's name without its extension.
std::string output_prefix(const Arguments& arguments) {
  const std::filesystem::path deck(arguments.deck), given(arguments.prefix);
  if (given.empty()) return std::filesystem::path(deck).replace_extension().string();
  std::error_code ignored;  // what cannot be looked at is no directory
  if (!given.has_filename() || std::filesystem::is_directory(given, ignored)) return (given / deck.stem()).string();
  return arguments.prefix;
}

int run_deck(const Arguments& arguments) {
  Job job;
  job.task = arguments.check ? Task::check : arguments.integrate ? Task::integrate : Task::automatic;
  job.deck = arguments.deck;
  job.output = output_prefix(arguments);
  job.output_is_prefix = true;
  job.options = arguments.options;
  const bool live = !arguments.quiet && !arguments.json && ::isatty(STDERR_FILENO) != 0;
  if (live) job.progress = progress_line();

  const Outcome outcome = run_job(job);
  if (live && outcome.analysis == "integrate") std::fprintf(stderr, "\r                    \r");
  bool told = false;
  for (const Diagnostic& diagnostic : outcome.diagnostics) {
    if (arguments.quiet && diagnostic.severity == Severity::warning) continue;
    std::fprintf(stderr, "%s\n", diagnostic.format().c_str());
    told = told || diagnostic.severity == Severity::error;
  }
  if (outcome.status != Status::ok && !told) std::fprintf(stderr, "mbdae: error: %s\n", outcome.message.c_str());
  if (arguments.json) {
    std::printf("%s\n", reply_line(nullptr, outcome).c_str());
  } else if (outcome.status == Status::ok && !arguments.quiet) {
    print_summary(arguments.deck, outcome);
  }
  if (std::fflush(stdout) != 0) {
    std::perror("mbdae: error: standard output");
    return 1;
  }
  return exit_code(outcome.status);
}

}  // namespace

int run_command_line(int argc, char** argv) {
  CLI::App app{kDescription, "mbdae"};
  Arguments arguments;
  declare(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {  // --help, --version
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::cerr << "mbdae: error: " << error.what() << "; see mbdae --help\n";
    return 1;
  }
  if (arguments.serve) {
    std::signal(SIGPIPE, SIG_IGN);
    if (arguments.parent > 0) watch_parent(arguments.parent);
    return serve(STDIN_FILENO, STDOUT_FILENO);
  }
  if (arguments.deck.empty()) {
    std::cerr << "mbdae: error: no deck given; see mbdae --help\n";
    return 1;
  }
  return run_deck(arguments);
}

}  // namespace mbdae
