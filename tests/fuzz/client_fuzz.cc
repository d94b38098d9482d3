// What the command line reads: initial conditions, gains, the files of both.
#include <unistd.h>

#include <fstream>

#include "client/cli/gains_file.h"
#include "client/cli/initial_condition.h"
#include "client/cli/initial_condition_file.h"
#include "client/cli/parse.h"
#include "google/protobuf/util/message_differencer.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

// A file in memory with these bytes; its name ends as asked. One at a time.
std::string FileWith(std::string_view bytes, const char* suffix) {
  static const std::string stem = "/dev/shm/orbitune-fuzz-" + std::to_string(getpid());
  std::string path = stem + suffix;
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
  return path;
}

// Forms without '=' are names of files, which are the system's to find.
void InitialCondition(std::string_view input) {
  if (TakeChoice(input, 2) == 0) {
    if (input.find('=') == input.npos || input.ends_with(".json")) return;
    (void)cli::ParseInitialCondition(std::string(input));
  } else {
    (void)cli::ParseGains(std::string(input));
    (void)cli::ParsePair(std::string(input));
    (void)cli::ResourceName("jobs", std::string(input));
  }
}

void InitialConditions(std::string_view input) {
  const bool csv = TakeChoice(input, 2) == 0;
  const std::string path = FileWith(input, csv ? "-conditions.csv" : "-conditions.json");
  const auto conditions = cli::ReadInitialConditions(path);
  unlink(path.c_str());
  if (csv && conditions.ok()) Expect(conditions->list_size() > 0, "a table that is read has initial conditions");
}

// What is read can be exported, and what was exported is read as it was.
void GainSets(std::string_view input) {
  const bool csv = TakeChoice(input, 2) == 0;
  std::string path = FileWith(input, csv ? "-gains.csv" : "-gains.json");
  const auto sets = cli::ReadGainSets(path);
  unlink(path.c_str());
  if (!sets.ok()) return;
  std::string table = cli::GainSetCsvHeader() + "\n";
  for (const cli::ReadGainSet& read : *sets) {
    table += cli::GainSetCsvRow(read.set) + "\n";
    (void)cli::GainSetCHeader(read.set);
  }
  if (!csv) return;
  path = FileWith(table, "-again.csv");
  const auto again = cli::ReadGainSets(path);
  unlink(path.c_str());
  Expect(again.ok(), "an exported table can be read");
  Expect(again->size() == sets->size(), "and has every gain set");
  for (std::size_t i = 0; i < sets->size(); ++i) {
    Expect(cli::GainSetCsvRow((*again)[i].set) == cli::GainSetCsvRow((*sets)[i].set), "as it was");
  }
}

const Registration kInitialCondition("initial_condition", InitialCondition);
const Registration kInitialConditions("initial_conditions", InitialConditions);
const Registration kGainSets("gain_sets", GainSets);

}  // namespace
}  // namespace orbitune::fuzz
