// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/serve.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "mbdae/job.h"
#include "mbdae/reply.h"

namespace mbdae {

namespace {

/// Longest accepted request line [bytes]; a longer one is skipped to its end and refused.
constexpr std::size_t kLongestLine = 64u << 20;
/// Deepest accepted nesting of a request; the serialiser of replies is recursive, and `id` is returned unchanged.
constexpr int kDeepestNesting = 32;

class BadRequest : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

std::string quote(const std::string& text) { return "'" + text + "'"; }

// ---- options -----------------------------------------------------------------------------------------------------

double number_of(const std::string& name, const Json& value) {
  if (!value.is_number()) throw BadRequest("option " + quote(name) + " must be a number, not " + value.type_name());
  return value.get<double>();
}

int count_of(const std::string& name, const Json& value) {
  const double number = number_of(name, value);
  if (number != std::floor(number) || number < 1 || number > std::numeric_limits<int>::max()) {
    throw BadRequest("option " + quote(name) + " must be a whole number of at least 1");
  }
  return static_cast<int>(number);
}

double positive(const std::string& name, const Json& value) {
  const double number = number_of(name, value);
  if (!(number > 0.0) || !std::isfinite(number)) {
    throw BadRequest("option " + quote(name) + " must be greater than zero");
  }
  return number;
}

std::string text_of(const std::string& what, const Json& value) {
  if (!value.is_string()) throw BadRequest(what + " must be a string, not " + value.type_name());
  return value.get<std::string>();
}

JobOptions read_options(const Json& given) {
  if (!given.is_object()) throw BadRequest(std::string("'options' must be an object, not ") + given.type_name());
  JobOptions options;
  for (const auto& [name, value] : given.items()) {
    if (name == "c") {
      options.c = positive(name, value);
    } else if (name == "state") {
      options.state = text_of("option 'state'", value);
    } else if (name == "tolerance") {
      options.tolerance = positive(name, value);
    } else if (name == "max_iterations") {
      options.max_iterations = count_of(name, value);
    } else if (name == "integrator") {
      options.integrator = text_of("option 'integrator'", value);
      if (*options.integrator != "ida" && *options.integrator != "ms") {
        throw BadRequest("option 'integrator' must be 'ida' or 'ms', not " + quote(*options.integrator));
      }
    } else if (name == "rtol") {
      options.rtol = positive(name, value);
    } else if (name == "atol") {
      options.atol = positive(name, value);
    } else if (name == "final_time") {
      options.final_time = number_of(name, value);
    } else if (name == "time_step") {
      options.time_step = positive(name, value);
    } else if (name == "every") {
      options.every = count_of(name, value);
    } else if (name == "channels") {
      if (!value.is_array()) throw BadRequest("option 'channels' must be a list of names");
      for (const Json& channel : value) options.channels.push_back(text_of("a name in option 'channels'", channel));
    } else if (name == "samples") {
      options.samples = text_of("option 'samples'", value);
    } else if (name == "harmonics") {
      options.harmonics = count_of(name, value);
    } else if (name == "instants") {
      options.instants = count_of(name, value);
    } else if (name == "tangents") {
      if (!value.is_boolean()) throw BadRequest("option 'tangents' must be true or false");
      options.tangents = value.get<bool>();
    } else if (name == "tangents_every") {
      options.tangents_every = count_of(name, value);
    } else if (name == "layout") {
      if (!value.is_boolean()) throw BadRequest("option 'layout' must be true or false");
      options.layout = value.get<bool>();
    } else if (name == "nodes") {
      if (!value.is_boolean()) throw BadRequest("option 'nodes' must be true or false");
      options.nodes = value.get<bool>();
    } else {
      throw BadRequest("unknown option " + quote(name) +
                       "; known: c, state, tolerance, max_iterations, integrator, rtol, atol, final_time, time_step, "
                       "every, channels, samples, harmonics, instants, tangents, tangents_every, layout, nodes");
    }
  }
  return options;
}

// ---- requests ----------------------------------------------------------------------------------------------------

Task task_of(const std::string& name) {
  if (name == "check") return Task::check;
  if (name == "static") return Task::static_equilibrium;
  if (name == "linearise") return Task::linearise;
  if (name == "integrate") return Task::integrate;
  if (name == "residuals") return Task::residuals;
  throw BadRequest("unknown task " + quote(name) + "; known: check, static, linearise, integrate, residuals, version");
}

Json parse(const std::string& request) {
  const auto limit_depth = [](int depth, Json::parse_event_t, const Json&) {
    if (depth > kDeepestNesting) throw BadRequest("the request is nested too deeply");
    return true;
  };
  try {
    return Json::parse(request, limit_depth);
  } catch (const Json::parse_error& error) {
    throw BadRequest(std::string("the request is not JSON: byte ") + std::to_string(error.byte));
  } catch (const Json::exception& error) {
    throw BadRequest(std::string("the request is not JSON: ") + error.what());
  }
}

Outcome refuse(const std::string& message) {
  Outcome outcome;
  outcome.status = Status::bad_request;
  outcome.message = message;
  return outcome;
}

/// Does what the request says and fills `id` as soon as it is known.
Outcome handle(const std::string& line, Json& id) {
  const Json request = parse(line);
  if (!request.is_object()) {
    throw BadRequest(std::string("a request must be an object, not ") + request.type_name());
  }
  if (request.contains("id")) id = request["id"];
  if (!request.contains("task")) throw BadRequest("the request has no 'task'");

  Job job;
  bool has_deck = false;
  for (const auto& [key, value] : request.items()) {
    if (key == "deck") {
      job.deck = text_of("'deck'", value);
      has_deck = true;
    } else if (key == "text") {
      job.text = text_of("'text'", value);
    } else if (key == "output") {
      job.output = text_of("'output'", value);
    } else if (key == "options") {
      job.options = read_options(value);
    } else if (key != "id" && key != "task") {
      throw BadRequest("unknown key " + quote(key) + "; known: id, task, deck, text, output, options");
    }
  }
  const std::string task = text_of("'task'", request["task"]);
  if (task == "version") {
    Outcome outcome;
    outcome.message = program_version();
    return outcome;
  }
  job.task = task_of(task);
  if (!has_deck && !job.text) throw BadRequest("the request has neither 'deck' nor 'text'");
  if (!has_deck) job.deck = "deck";
  return run_job(job);
}

// ---- lines -------------------------------------------------------------------------------------------------------

/// Cuts a descriptor into lines.
class LineReader {
 public:
  explicit LineReader(int fd) : fd_(fd) {}

  enum class Result { line, too_long, end };

  Result next(std::string& line) {
    line.clear();
    bool too_long = false;
    while (true) {
      if (position_ == filled_ && !fill()) {
        if (too_long) return Result::too_long;
        return line.empty() ? Result::end : Result::line;
      }
      const char* begin = buffer_ + position_;
      const char* end = static_cast<const char*>(std::memchr(begin, '\n', filled_ - position_));
      const std::size_t size = end ? static_cast<std::size_t>(end - begin) : filled_ - position_;
      position_ += size + (end ? 1 : 0);
      if (line.size() + size > kLongestLine) too_long = true;
      if (too_long) {
        line.clear();
      } else {
        line.append(begin, size);
      }
      if (end) return too_long ? Result::too_long : Result::line;
    }
  }

 private:
  bool fill() {
    ssize_t count = 0;
    do {
      count = ::read(fd_, buffer_, sizeof buffer_);
    } while (count < 0 && errno == EINTR);
    position_ = 0;
    filled_ = count > 0 ? static_cast<std::size_t>(count) : 0;
    return filled_ > 0;
  }

  int fd_;
  char buffer_[65536];
  std::size_t position_ = 0, filled_ = 0;
};

bool write_all(int fd, const std::string& text) {
  std::size_t written = 0;
  while (written < text.size()) {
    const ssize_t count = ::write(fd, text.data() + written, text.size() - written);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    written += static_cast<std::size_t>(count);
  }
  return true;
}

}  // namespace

std::string answer(const std::string& request) {
  Json id = nullptr;
  Outcome outcome;
  try {
    outcome = handle(request, id);
  } catch (const BadRequest& error) {
    outcome = refuse(error.what());
  } catch (const std::bad_alloc&) {
    outcome.status = Status::internal_error;
    outcome.message = "out of memory";
  } catch (const std::exception& error) {
    outcome.status = Status::internal_error;
    outcome.message = std::string("unexpected: ") + error.what();
  }
  return reply_line(id, outcome);
}

int serve(int in, int out) {
  LineReader reader(in);
  std::string line;
  while (true) {
    std::string reply;
    switch (reader.next(line)) {
      case LineReader::Result::end:
        return 0;
      case LineReader::Result::too_long:
        reply = reply_line(nullptr, refuse("the request is longer than 64 MB"));
        break;
      case LineReader::Result::line:
        reply = answer(line);
        break;
    }
    reply += '\n';
    if (!write_all(out, reply)) {
      std::fprintf(stderr, "mbdae: nobody reads the replies: %s\n", std::strerror(errno));
      return 1;
    }
  }
}

}  // namespace mbdae
