// The bash completion script, from a description of the commands that app.cc takes from its parser.
#pragma once

#include <string>
#include <vector>

namespace orbitune::cli {

struct OptionSpec {
  std::vector<std::string> flags;  // "--output", "-o"; empty for a positional
  // What follows: "" nothing, "FILE", "JOB", "SCENARIO", a choice "csv|json" (no capitals), else: not completed.
  std::string value;
};

struct CommandSpec {
  std::string name;  // "" for the program itself
  std::vector<OptionSpec> options;
};

// The program itself comes first; its options hold for every command.
std::string BashCompletion(const std::vector<CommandSpec>& commands);

}  // namespace orbitune::cli
