// Every parser of ours that reads what others wrote, as a function of any bytes. libFuzzer searches with them
// (CMake preset `fuzz`, program orbitune_fuzz); the ordinary builds run them over the corpus and what grows from it
// (orbitune_fuzz_replay).
#pragma once

#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <string_view>

namespace orbitune::fuzz {

// Reads the input as a parser would. Any bytes are allowed; what must hold is checked with Expect.
using Parser = void (*)(std::string_view input);

// By name, as the folders of the corpus are called.
inline std::map<std::string, Parser>& Parsers() {
  static std::map<std::string, Parser> parsers;
  return parsers;
}

struct Registration {
  Registration(const char* name, Parser parser) { Parsers().emplace(name, parser); }
};

// Ends the process: a finding.
inline void Expect(bool holds, std::string_view what) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: does not hold: %.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

// Takes the first byte away: which of several readers is meant.
inline unsigned TakeChoice(std::string_view& input, unsigned choices) {
  if (input.empty()) return 0;
  const auto first = static_cast<unsigned char>(input.front());
  input.remove_prefix(1);
  return first % choices;
}

// Takes the text up to the next line end away.
inline std::string_view TakeLine(std::string_view& input) {
  const std::string_view line = input.substr(0, input.find('\n'));
  input.remove_prefix(line.size() == input.size() ? line.size() : line.size() + 1);
  return line;
}

}  // namespace orbitune::fuzz
