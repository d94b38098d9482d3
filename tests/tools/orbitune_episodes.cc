// orbitune_episodes FILE: simulates every case of FILE and prints a JSON array of what came out. Exit status 2 where
// FILE is missing or is not what it should be.
#include <cstdio>
#include <iostream>

#include "tests/tools/episode_file.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: orbitune_episodes FILE\n");
    return 2;
  }
  const auto episodes = orbitune::ReadEpisodeFile(argv[1]);
  if (!episodes.ok()) {
    std::fprintf(stderr, "orbitune_episodes: %s: %s\n", argv[1], std::string(episodes.status().message()).c_str());
    return 2;
  }
  nlohmann::ordered_json results = nlohmann::ordered_json::array();
  for (const auto& episode : *episodes) results.push_back(orbitune::RunEpisode(episode));
  std::cout << results.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
  return std::cout.good() ? 0 : 1;
}
