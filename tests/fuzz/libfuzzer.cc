// orbitune_fuzz --parser=NAME [libFuzzer's options] CORPUS...
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "tests/fuzz/fuzz.h"

namespace {

orbitune::fuzz::Parser parser = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  constexpr std::string_view kFlag = "--parser=";  // libFuzzer leaves alone what has two dashes
  for (int i = 1; i < *argc; ++i) {
    const std::string_view argument = (*argv)[i];
    if (!argument.starts_with(kFlag)) continue;
    const auto found = orbitune::fuzz::Parsers().find(std::string(argument.substr(kFlag.size())));
    if (found != orbitune::fuzz::Parsers().end()) parser = found->second;
  }
  if (parser != nullptr) return 0;
  std::fprintf(stderr, "usage: orbitune_fuzz --parser=NAME [libFuzzer's options] CORPUS...\nparsers:");
  for (const auto& [name, function] : orbitune::fuzz::Parsers()) std::fprintf(stderr, " %s", name.c_str());
  std::fprintf(stderr, "\n");
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  parser(std::string_view(reinterpret_cast<const char*>(data), size));
  return 0;
}
