#include "server/config/config.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <memory>
#include <thread>

namespace orbitune {
namespace {

std::string DefaultDataDir() {
  if (const char* xdg = std::getenv("XDG_DATA_HOME"); xdg != nullptr && *xdg != '\0') {
    return std::string(xdg) + "/orbitune";
  }
  const char* home = std::getenv("HOME");
  return home != nullptr && *home != '\0' ? std::string(home) + "/.local/share/orbitune" : "orbitune-data";
}

std::string CheckAddress(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  const std::string port = colon == std::string::npos ? "" : text.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (colon != 0 && digits && std::stoi(port) <= 65535) return "";
  return "must be HOST:PORT with a port in [0, 65535] (0: any free one), got \"" + text + "\"";
}

// CLI11 has a file's values win over the environment's: leaves out of the file what the environment says.
class EnvironmentFirst : public CLI::ConfigBase {
 public:
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override {
    std::vector<CLI::ConfigItem> given = ConfigBase::from_config(input);
    std::erase_if(given, [](const CLI::ConfigItem& item) { return InEnvironment(item.name); });
    return given;
  }

 private:
  static bool InEnvironment(const std::string& option) {
    std::string name = "ORBITUNE_";
    for (const char c : option) name += c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    const char* value = std::getenv(name.c_str());
    return value != nullptr && *value != '\0';
  }
};

}  // namespace

std::optional<ServerConfig> ParseServerConfig(int argc, char** argv, int& exit_code) {
  ServerConfig config;
  config.data_dir = DefaultDataDir();
  CLI::App app(
      "orbituned: the Orbitune tuning server. Every option can also be given in the environment, or in the "
      "configuration file (TOML: listen = \"127.0.0.1:7313\").",
      "orbituned");
  app.set_version_flag("--version", "orbituned " ORBITUNE_VERSION);
  // CLI11 looks into the environment only after the file: what it says is the default, and has to be there.
  const char* config_file = std::getenv("ORBITUNE_CONFIG");
  const bool in_environment = config_file != nullptr && *config_file != '\0';
  app.set_config("--config", in_environment ? config_file : "", "Configuration file", in_environment)
      ->envname("ORBITUNE_CONFIG");
  app.config_formatter(std::make_shared<EnvironmentFirst>());
  app.allow_config_extras(CLI::config_extras_mode::error);
  app.add_option("--data-dir", config.data_dir, "Where the database is kept; made if it is not there")
      ->envname("ORBITUNE_DATA_DIR")
      ->capture_default_str();
  app.add_option("--listen", config.listen, "gRPC address, HOST:PORT; port 0: any free one")
      ->envname("ORBITUNE_LISTEN")
      ->check(CheckAddress)
      ->capture_default_str();
  app.add_option("--http", config.http,
                 "HTTP address, HOST:PORT, kept for REST and the dashboard (not in this version)")
      ->envname("ORBITUNE_HTTP")
      ->check(CheckAddress)
      ->capture_default_str();
  app.add_option("--threads", config.threads, "Worker threads; 0: one per core. Results do not depend on it")
      ->envname("ORBITUNE_THREADS")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_option("--max-running-jobs", config.max_running_jobs, "Jobs that share the workers; the others wait")
      ->envname("ORBITUNE_MAX_RUNNING_JOBS")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  app.add_option("--simd", config.simd, "Instruction set of the episode kernel: auto, avx512, avx2 or baseline")
      ->envname("ORBITUNE_SIMD")
      ->check(CLI::IsMember({"auto", "avx512", "avx2", "baseline"}))
      ->capture_default_str();
  app.footer(
      "SIGTERM or SIGINT: unfinished jobs are kept and taken up at the next start.\n"
      "Exit status: 0 stopped by a signal, 1 could not start, 2 wrong usage.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    exit_code = app.exit(error) == 0 ? 0 : 2;
    return std::nullopt;
  }
  if (config.threads == 0) config.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  return config;
}

}  // namespace orbitune
