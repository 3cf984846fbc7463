// Fuzz driver of the deck reader: mutates the reference decks for some seconds, or reads inputs of 10 MB of one thing;
// nothing may crash, hang, throw or take more than a bounded amount of memory.
//
//   fuzz_deck [seconds = 10] [seed = 1]
//   fuzz_deck large
//
// Every mutation follows from the seed and its number, so a failure can be played again. Best built with
// -fsanitize=address,undefined. The last input is kept in the temporary directory (fuzz_deck_input.mbd) until it has
// been read.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "mbdae/elements/force.h"
#include "mbdae/elements/table.h"
#include "mbdae/elements/total.h"

namespace {

namespace fs = std::filesystem;
using Generator = std::mt19937_64;

/// Beside the files that a seed names.
const char* const kName = TEST_DATA_DIR "/deck_cards/fuzz.mbd";

std::vector<std::string> load_seeds() {
  std::vector<fs::path> paths;
  for (const char* directory : {TEST_DATA_DIR "/mbdyn_cases", TEST_DATA_DIR "/deck_cards"}) {
    for (const auto& entry : fs::directory_iterator(directory)) {
      if (entry.path().extension() == ".mbd") paths.push_back(entry.path());
    }
  }
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> seeds;
  for (const fs::path& path : paths) {
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    seeds.push_back(text.str());
  }
  return seeds;
}

/// Words of the language and of trouble, to be planted anywhere.
const std::vector<std::string> kTokens = {",",
                                          ";",
                                          ":",
                                          "(",
                                          ")",
                                          "\"",
                                          "/*",
                                          "#",
                                          "::",
                                          "^",
                                          "-",
                                          "%",
                                          "1/0",
                                          "1e999",
                                          "2147483648",
                                          "-1",
                                          "0.",
                                          "null",
                                          "eye",
                                          "reference,",
                                          "other position,",
                                          "other orientation,",
                                          "global,",
                                          "node,",
                                          "node",
                                          "const,",
                                          "array, 1000000000,",
                                          "string, \"sin(Time)/Time\",",
                                          "string, \"1/0\",",
                                          "string, \"Var^Var^Var\",",
                                          "cosine, 0., 1., 1., half, 0.,",
                                          "ramp, 1., 0., forever, 0.,",
                                          "mult,",
                                          "component,",
                                          "single,",
                                          "scale,",
                                          "condense, 3,",
                                          "diag,",
                                          "sym,",
                                          "matr,",
                                          "euler313,",
                                          "vector,",
                                          "guess",
                                          "degrees,",
                                          "from nodes",
                                          "linear viscoelastic generic,",
                                          "proportional,",
                                          "prestress,",
                                          "prestrain,",
                                          "cubic elastic generic,",
                                          "muscle,",
                                          "reflexive,",
                                          "short range stiffness,",
                                          "set: real A = A + 1.;",
                                          "set: integer I = INT_MAX + 1;",
                                          "set: string S = \"a\" + \"b\";",
                                          "include: \"nowhere.mbd\";",
                                          "end: nodes;",
                                          "begin: elements;",
                                          "initial state,",
                                          "inverse dynamics,",
                                          "output, yes",
                                          "model::current(\"L0\")",
                                          "sprintf(\"%5d\", 3)",
                                          "rand()",
                                          "\xff\xfe",
                                          std::string("\0", 1),
                                          "begin: drivers;",
                                          "end: drivers;",
                                          "file: 1, variable step, 1,",
                                          "file: 1, fixed step, count, 2, initial time, from file,",
                                          "file, 1, 2, amplitude,",
                                          "pad zeroes, no,",
                                          "driven: 1, 1.,",
                                          "driven: 1, 0., existing: joint,",
                                          "axial rotation,",
                                          "cardano rotation,",
                                          "double linear elastic, 1., 1., -1., 2.,",
                                          "scalar function elastic,",
                                          "relative frame,",
                                          "chdir: \".\";",
                                          "setenv: \"A=1\";",
                                          "strategy: change,",
                                          "joint:",
                                          "body:",
                                          "structural:",
                                          "reference:",
                                          "drive caller:",
                                          "constitutive law:",
                                          "forever",
                                          "TRUE",
                                          "1.e-320",
                                          "(real x = 1.; x)",
                                          "at reference,"};

std::string mutated(const std::vector<std::string>& seeds, Generator& random) {
  const auto below = [&random](std::size_t n) { return n == 0 ? 0 : static_cast<std::size_t>(random() % n); };
  std::string text = seeds[below(seeds.size())];
  const std::size_t changes = 1 + below(8);
  for (std::size_t change = 0; change < changes; ++change) {
    const std::size_t at = below(text.size() + 1);
    const std::size_t length = std::min(below(200), text.size() - at);
    switch (below(9)) {
      case 0:  // flip a bit
        if (at < text.size()) text[at] = static_cast<char>(text[at] ^ (1 << below(8)));
        break;
      case 1:
        text.insert(at, kTokens[below(kTokens.size())]);
        break;
      case 2:
        text.erase(at, length);
        break;
      case 3:  // repeat a piece
        text.insert(below(text.size() + 1), text.substr(at, length));
        break;
      case 4: {  // a piece of another deck
        const std::string& other = seeds[below(seeds.size())];
        text.insert(at, other.substr(below(other.size()), below(500)));
        break;
      }
      case 5:
        if (below(4) == 0) text.resize(at);
        break;
      case 6: {  // swap two pieces
        const std::string piece = text.substr(at, length);
        text.erase(at, length);
        text.insert(below(text.size() + 1), piece);
        break;
      }
      case 7: {  // replace a number
        const std::size_t digit = text.find_first_of("0123456789", at);
        if (digit != std::string::npos) text.replace(digit, 1, kTokens[below(kTokens.size())]);
        break;
      }
      default: {  // nest deeply
        static const char* const kNests[] = {"(", "-", "2^", "sin(", "1+", "array, 1, ", "mult, 1., ", "!", "(1;"};
        const std::string nest = kNests[below(std::size(kNests))];
        std::string many;
        for (std::size_t i = 0, n = below(2000); i < n; ++i) many += nest;
        text.insert(at, many);
        break;
      }
    }
  }
  return text;
}

/// Every drive the deck has is evaluated: no value may crash it.
double use(const mbdae::Deck& deck) {
  double sum = 0.0;
  const auto take = [&sum](const auto& vector) { sum += std::isfinite(vector.sum()) ? 1.0 : 0.0; };
  for (const double t : {-1.0, 0.0, 0.5, 1e300}) {
    for (int derivative = 0; derivative < 3; ++derivative) {
      if (deck.gravity) take(deck.gravity->at(t, derivative));
      for (const auto& force : deck.forces) take(force.as<mbdae::ForceData>().value.at(t, derivative));
      for (const auto& joint : deck.joints) {
        if (const auto* total = joint.get_if<mbdae::TotalJointData>()) take(total->position_drive.at(t, derivative));
      }
    }
  }
  return sum;
}

/// Fails loudly: the promises of reader.h.
void check(const std::string& text) {
  const auto begin = std::chrono::steady_clock::now();
  const mbdae::ReadResult result = mbdae::read_deck_text(text, kName);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  bool error = false;
  for (const auto& diagnostic : result.diagnostics) error = error || diagnostic.severity == mbdae::Severity::error;
  if (error == result.deck.has_value()) {
    std::fprintf(stderr, "a deck with errors, or no deck without them\n");
    std::abort();
  }
  if (result.deck) use(*result.deck);
  // Generous (sanitizers, a busy machine), but quadratic behaviour does not pass.
  const double limit = 2.0 + 5e-6 * static_cast<double>(text.size());
  if (seconds > limit) {
    std::fprintf(stderr, "%zu characters took %.1f s\n", text.size(), seconds);
    std::abort();
  }
}

/// A deck of 10 MB may not take more than this, whatever is in it; sanitizers double and keep what is freed.
void check_memory() {
  constexpr long kLimitMB = 3000;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const long used_MB = usage.ru_maxrss / 1024;
  std::printf("%ld MB at most\n", used_MB);
  if (used_MB > kLimitMB) {
    std::fprintf(stderr, "more than %ld MB\n", kLimitMB);
    std::abort();
  }
}

std::string repeated(const std::string& piece, std::size_t characters) {
  std::string text;
  text.reserve(characters + piece.size());
  while (text.size() < characters) text += piece;
  return text;
}

/// Inputs of 10 MB of one thing.
void check_large() {
  const std::string head = "begin: data; problem: initial value; end: data; ";
  for (const char* piece : {"(",
                            ")",
                            "\"",
                            "/*",
                            "#",
                            "a ",
                            "1+",
                            "-",
                            ";",
                            ":",
                            ",",
                            "set: real a = 1.; ",
                            "set: 1;",
                            "x: ;",
                            "joint: ",
                            "\n\"",
                            "array, 1, ",
                            "1 ",
                            "begin: data;",
                            "\xe9",
                            "a: \"",
                            "set: (1;",
                            "2^"}) {
    check(repeated(piece, 10'000'000));
    check(head + "set: real a = " + repeated(piece, 10'000'000));
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "large") {
    check_large();
    check_memory();
    return 0;
  }
  const double budget = argc > 1 ? std::atof(argv[1]) : 10.0;
  const auto seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1ULL;
  const std::vector<std::string> seeds = load_seeds();
  if (seeds.empty()) {
    std::fprintf(stderr, "no decks in %s\n", TEST_DATA_DIR "/mbdyn_cases");
    return 1;
  }
  for (const std::string& text : seeds) check(text);
  const auto begin = std::chrono::steady_clock::now();
  const fs::path kept = fs::temp_directory_path() / "fuzz_deck_input.mbd";
  unsigned long long count = 0, read = 0;
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < budget) {
    Generator random(seed * 1'000'003ULL + count);
    const std::string text = mutated(seeds, random);
    std::ofstream(kept, std::ios::binary) << text;
    check(text);
    read += mbdae::read_deck_text(text, kName).deck.has_value() ? 1 : 0;
    ++count;
  }
  fs::remove(kept);
  check_memory();
  std::printf("%llu mutated decks read, %llu of them without errors\n", count, read);
  return 0;
}
