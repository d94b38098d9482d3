// The server's configuration file and the files of reference episodes.
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <fstream>

#include "server/config/config.h"
#include "tests/fuzz/fuzz.h"
#include "tests/tools/episode_file.h"

namespace orbitune::fuzz {
namespace {

// Says what it has to say to nobody.
class Silence {
 public:
  Silence() {
    std::fflush(nullptr);
    for (const int stream : kStreams) {
      saved_[static_cast<std::size_t>(stream)] = dup(stream);
      const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
      dup2(null, stream);
      close(null);
    }
  }
  ~Silence() {
    std::fflush(nullptr);
    for (const int stream : kStreams) {
      dup2(saved_[static_cast<std::size_t>(stream)], stream);
      close(saved_[static_cast<std::size_t>(stream)]);
    }
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  static constexpr std::array<int, 2> kStreams = {STDOUT_FILENO, STDERR_FILENO};
  std::array<int, 3> saved_ = {};
};

void Configuration(std::string_view input) {
  static const std::string path = "/dev/shm/orbitune-fuzz-conf-" + std::to_string(getpid());
  std::ofstream(path, std::ios::binary | std::ios::trunc) << input;
  std::string program = "orbituned", flag = "--config", file = path;
  std::array<char*, 4> arguments = {program.data(), flag.data(), file.data(), nullptr};
  int exit_code = -1;
  bool given = false;
  {
    const Silence silence;
    given = ParseServerConfig(3, arguments.data(), "", exit_code).has_value();
  }
  unlink(path.c_str());
  Expect(given || exit_code == 2 || exit_code == 0, "a configuration, or a refusal");
}

void EpisodeFile(std::string_view input) { (void)ParseEpisodeFile(input); }

const Registration kConfiguration("configuration", Configuration);
const Registration kEpisodeFile("episode_file", EpisodeFile);

}  // namespace
}  // namespace orbitune::fuzz
