// orbitune_fuzz_replay CORPUS [MUTATIONS]: every parser over its folder of the corpus, and over MUTATIONS inputs that
// grow out of it by a seeded generator. For builds without libFuzzer; a finding ends the process, its input is kept.
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

namespace fs = std::filesystem;

const std::string* current = nullptr;  // what a parser is reading

void KeepFinding(int signal) {
  std::signal(signal, SIG_DFL);
  if (current != nullptr) {
    if (std::FILE* file = std::fopen("fuzz-finding", "wb"); file != nullptr) {
      std::fwrite(current->data(), 1, current->size(), file);
      std::fclose(file);
      std::fprintf(stderr, "orbitune_fuzz_replay: its input is in ./fuzz-finding\n");
    }
  }
  std::raise(signal);
}

std::vector<std::string> Corpus(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::ranges::sort(files);  // the same inputs in the same order everywhere
  std::vector<std::string> inputs;
  for (const fs::path& file : files) {
    std::ifstream in(file, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  return inputs;
}

// One of the changes that break parsers: a byte, a piece lost or twice, a piece of another input, an odd token.
void Mutate(std::string& input, const std::vector<std::string>& corpus, std::mt19937_64& random) {
  static const std::vector<std::string> tokens = {"\"",
                                                  "{",
                                                  "}",
                                                  "[",
                                                  "]",
                                                  ":",
                                                  ",",
                                                  "=",
                                                  "%",
                                                  "\n",
                                                  "0",
                                                  "-1",
                                                  "1e999",
                                                  "NaN",
                                                  "null",
                                                  "true",
                                                  "\\u0000",
                                                  "\xff",
                                                  "/",
                                                  "..",
                                                  std::string(1, '\0'),
                                                  "99999999999999999999"};
  const auto below = [&](std::size_t limit) { return limit == 0 ? 0 : static_cast<std::size_t>(random() % limit); };
  const std::size_t at = below(input.size() + 1);
  switch (below(5)) {
    case 0:
      if (at < input.size()) input[at] = static_cast<char>(random());
      break;
    case 1:
      input.erase(at, below(16) + 1);
      break;
    case 2:
      input.insert(at, input.substr(below(input.size() + 1), below(64)));
      break;
    case 3: {
      const std::string& other = corpus[below(corpus.size())];
      input.replace(at, below(32), other.substr(below(other.size() + 1), below(64)));
      break;
    }
    default:
      input.insert(at, tokens[below(tokens.size())]);
  }
}

void Run(Parser parser, const std::string& input) {
  current = &input;
  parser(input);
  current = nullptr;
}

// How many inputs it was.
std::size_t Replay(Parser parser, const fs::path& folder, std::size_t mutations) {
  const std::vector<std::string> corpus = Corpus(folder);
  Expect(!corpus.empty(), folder.string() + " has inputs");
  for (const std::string& input : corpus) Run(parser, input);
  std::mt19937_64 random(1);
  for (std::size_t i = 0; i < mutations; ++i) {
    std::string input = corpus[static_cast<std::size_t>(random() % corpus.size())];
    for (std::size_t changes = random() % 8 + 1; changes > 0; --changes) Mutate(input, corpus, random);
    Run(parser, input);
  }
  return corpus.size() + mutations;
}

int Main(const fs::path& corpus, std::size_t mutations) {
  for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, KeepFinding);
  for (const auto& [name, parser] : Parsers()) {
    std::printf("%s: %zu inputs\n", name.c_str(), Replay(parser, corpus / name, mutations));
  }
  for (const fs::directory_entry& folder : fs::directory_iterator(corpus)) {
    Expect(Parsers().contains(folder.path().filename().string()), folder.path().string() + " is a parser's");
  }
  return 0;
}

}  // namespace
}  // namespace orbitune::fuzz

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: orbitune_fuzz_replay CORPUS [MUTATIONS]\n");
    return 2;
  }
  return orbitune::fuzz::Main(argv[1], argc == 3 ? std::stoul(argv[2]) : 0);
}
