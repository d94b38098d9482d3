#include "server/config/config.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <thread>

namespace orbitune {
namespace {

std::string CheckAddress(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  const std::string port = colon == std::string::npos ? "" : text.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (colon != 0 && digits && std::stoi(port) <= 65535) return "";
  return "must be HOST:PORT with a port in [0, 65535] (0: any free one), got \"" + text + "\"";
}

std::string CheckHttpAddress(const std::string& text) { return text == "off" ? "" : CheckAddress(text); }

std::string CheckOrigin(const std::string& text) {
  const std::size_t scheme = text.find("://");
  const bool is_origin = (text.starts_with("http://") || text.starts_with("https://")) && text.size() > scheme + 3 &&
                         text.find_first_of("/?# ", scheme + 3) == std::string::npos;
  return is_origin || text == "*" ? "" : "must be SCHEME://HOST[:PORT] or *, got \"" + text + "\"";
}

// Where an installation has the dashboard, else beside the binary.
std::string DefaultWebDir() {
  std::error_code error;
  const auto binary = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return "web";
  const auto installed = binary.parent_path().parent_path() / "share/orbitune/web";
  return (std::filesystem::exists(installed, error) ? installed : binary.parent_path() / "web").string();
}

// "ORBITUNE_MAX_RUNNING_JOBS" of "max-running-jobs".
std::string EnvironmentNameOf(const std::string& option) {
  std::string name = "ORBITUNE_";
  for (const char c : option) name += c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return name;
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
    const char* value = std::getenv(EnvironmentNameOf(option).c_str());
    return value != nullptr && *value != '\0';
  }
};

// "--max-running-jobs" and ORBITUNE_MAX_RUNNING_JOBS.
template <typename Number>
void AddNumber(CLI::App& app, const std::string& name, Number& value, Number least, Number most,
               const char* description) {
  app.add_option("--" + name, value, description)
      ->envname(EnvironmentNameOf(name))
      ->check(CLI::Range(least, most))
      ->capture_default_str();
}

// What is beyond them is refused with RESOURCE_EXHAUSTED (over HTTP 429), which names the option and its value.
void AddLimits(CLI::App& app, ServerConfig& config) {
  constexpr int kMost = 10'000'000;
  AddNumber(app, "max-running-jobs", config.max_running_jobs, 1, 10'000,
            "Jobs that share the workers; the others wait, but for the first of each client: up to twice as many run");
  AddNumber(app, "max-queued-jobs", config.max_queued_jobs, 1, kMost,
            "Jobs that may wait to begin; half of them a client's");
  AddNumber(app, "max-jobs-per-client", config.max_jobs_per_client, 1, kMost,
            "Unfinished jobs of one client, those of campaigns left out");
  AddNumber(app, "max-campaigns-per-client", config.max_campaigns_per_client, 1, kMost,
            "Unfinished campaigns of one client");
  AddNumber(app, "max-job-memory-mib", config.max_job_memory_mib, 1, 1 << 20,
            "Memory for what unfinished jobs are made of; half of it a client's");
  AddNumber(app, "max-calls-waiting", config.max_calls_waiting, 1, kMost, "Calls of one kind that wait for a thread");
  AddNumber(app, "max-calls-waiting-per-client", config.max_calls_waiting_per_client, 1, kMost, "Those of one client");
  AddNumber(app, "max-waiting-mib", config.max_waiting_mib, 1, 1 << 20,
            "Memory for large requests that have not been answered");
  AddNumber(app, "max-episode-calls", config.max_episode_calls, 1, 1024,
            "Calls at a time that fly episodes: SimulateEpisode, QueryGains that refines");
  AddNumber(app, "max-verifications", config.max_verifications, 1, 1024, "Jobs verified at a time");
  AddNumber(app, "max-request-bytes", config.max_request_bytes, 1024, 1 << 30, "Largest request over gRPC");
  AddNumber(app, "max-response-bytes", config.max_response_bytes, 1024, 1 << 30, "Largest answer to a call");
  AddNumber(app, "max-watchers", config.max_watchers, 1, 1'000'000, "Streams open at a time");
  AddNumber(app, "max-watchers-per-client", config.max_watchers_per_client, 1, 1'000'000, "Those of one client");
  AddNumber(app, "max-streams-per-connection", config.max_streams_per_connection, 1, 1'000'000,
            "Calls at a time on one gRPC connection; a client waits with what comes beyond");
  AddNumber(app, "grpc-memory-mib", config.grpc_memory_mib, 16, 1 << 20,
            "Memory that gRPC may keep for connections and messages, those for slow watchers among them");
}

void AddLogOptions(CLI::App& app, ServerConfig& config) {
  app.add_option("--log-format", config.log_format, "Of the log on standard error: text or json, a line per event")
      ->envname("ORBITUNE_LOG_FORMAT")
      ->check(CLI::IsMember({"text", "json"}))
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "debug (every call), info, warning or error")
      ->envname("ORBITUNE_LOG_LEVEL")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
  AddNumber(app, "log-slow-call-s", config.log_slow_call_s, 0.0, 86'400.0,
            "Seconds after which a call is logged as slow");
}

void AddHttpOptions(CLI::App& app, ServerConfig& config) {
  app.add_option("--web-dir", config.web_dir, "The dashboard's files; need not exist")
      ->envname("ORBITUNE_WEB_DIR")
      ->capture_default_str();
  app.add_option("--http-cors-origin", config.http_cors_origins,
                 "SCHEME://HOST[:PORT] of a page from elsewhere that may call this server; may be given again; *: all")
      ->envname("ORBITUNE_HTTP_CORS_ORIGIN")
      ->check(CheckOrigin);
  AddNumber(app, "http-max-connections", config.http_max_connections, 1, 100'000,
            "HTTP connections at a time; more get 429");
  AddNumber(app, "http-max-connections-per-client", config.http_max_connections_per_client, 1, 100'000,
            "Those of one address (of IPv6, of a /64); behind a proxy all clients have one");
  AddNumber(app, "http-max-header-bytes", config.http_max_header_bytes, 1024, 1 << 20,
            "Largest head of an HTTP request");
  AddNumber(app, "http-max-body-bytes", config.http_max_body_bytes, 1024, 64 << 20, "Largest body of an HTTP request");
  AddNumber(app, "http-max-bodies-bytes", config.http_max_bodies_bytes, 1024, 1 << 30,
            "Bodies of all HTTP requests that are being received");
  AddNumber(app, "http-header-time-s", config.http_header_time_s, 0.1, 86'400.0,
            "Seconds within which a request's head must have arrived");
  AddNumber(app, "http-body-time-s", config.http_body_time_s, 0.1, 86'400.0,
            "Seconds within which its body must have arrived");
  AddNumber(app, "http-idle-time-s", config.http_idle_time_s, 0.1, 86'400.0,
            "Seconds after which a connection without a request is closed");
  AddNumber(app, "http-stall-time-s", config.http_stall_time_s, 0.1, 86'400.0,
            "Seconds after which a reader that takes nothing is cut off");
}

void AddTlsOptions(CLI::App& app, ServerConfig& config) {
  CLI::Option* const cert =
      app.add_option("--tls-cert", config.tls_cert, "PEM file of the server's certificate and what leads to its root")
          ->envname("ORBITUNE_TLS_CERT")
          ->type_name("FILE");
  CLI::Option* const key = app.add_option("--tls-key", config.tls_key, "PEM file of its key")
                               ->envname("ORBITUNE_TLS_KEY")
                               ->type_name("FILE");
  cert->needs(key);
  key->needs(cert);
  app.add_option("--tls-client-ca", config.tls_client_ca,
                 "PEM file of authorities: only clients with a certificate of theirs are let in")
      ->envname("ORBITUNE_TLS_CLIENT_CA")
      ->type_name("FILE")
      ->needs(cert);
  app.add_flag("--insecure", config.insecure,
               "Listen on an address that is not loopback even without TLS or tokens: whoever reaches it may read "
               "what passes, or do all")
      ->envname("ORBITUNE_INSECURE");
}

void AddStorageOptions(CLI::App& app, ServerConfig& config) {
  app.add_option("--start-check", config.start_check,
                 "What of the database is read before the start: crash: its structure for up to 10 s, where the last "
                 "server did not close it; full: all of it; off: nothing")
      ->envname("ORBITUNE_START_CHECK")
      ->check(CLI::IsMember({"crash", "full", "off"}))
      ->capture_default_str();
  AddNumber(app, "retain-jobs-days", config.retain_jobs_days, 0.0, 36'500.0,
            "Days after its end at which a job of no campaign is deleted; 0: never. Gain sets always stay");
  AddNumber(app, "retain-campaigns-days", config.retain_campaigns_days, 0.0, 36'500.0,
            "Likewise, a campaign with its jobs");
  AddNumber(app, "retain-iterations-days", config.retain_iterations_days, 0.0, 36'500.0,
            "Likewise, the iterations of a job but the first, the best and the last");
  AddNumber(app, "retain-backups-days", config.retain_backups_days, 0.0, 36'500.0,
            "Days after which a backup made before a migration is deleted; 0: never. The newest always stays");
  app.add_option(
         "--retain-audit-days", config.retain_audit_days,
         "Days after which an entry of the audit log is removed, at least 1; 0: never. What goes leaves an entry")
      ->envname("ORBITUNE_RETAIN_AUDIT_DAYS")
      ->check(CLI::Range(1.0, 36'500.0) | CLI::IsMember({0.0}))
      ->capture_default_str();
  app.add_option("--max-database-bytes", config.max_database_bytes,
                 "Bytes in use in the database (20GB will do) above which what ended first is removed, iterations "
                 "first; 0: no limit")
      ->envname("ORBITUNE_MAX_DATABASE_BYTES")
      ->transform(CLI::AsSizeValue(false))
      ->capture_default_str();
}

}  // namespace

std::string DefaultDataDir() {
  if (const char* xdg = std::getenv("XDG_DATA_HOME"); xdg != nullptr && *xdg != '\0') {
    return std::string(xdg) + "/orbitune";
  }
  const char* home = std::getenv("HOME");
  return home != nullptr && *home != '\0' ? std::string(home) + "/.local/share/orbitune" : "orbitune-data";
}

std::optional<ServerConfig> ParseServerConfig(int argc, char** argv, const std::string& footer, int& exit_code) {
  ServerConfig config;
  config.data_dir = DefaultDataDir();
  config.web_dir = DefaultWebDir();
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
  app.add_option("--http", config.http, "HTTP address (REST, dashboard), HOST:PORT; port 0: any free one; off: none")
      ->envname("ORBITUNE_HTTP")
      ->check(CheckHttpAddress)
      ->capture_default_str();
  AddHttpOptions(app, config);
  AddTlsOptions(app, config);
  AddStorageOptions(app, config);
  AddNumber(app, "threads", config.threads, 0, 1024, "Worker threads; 0: one per core. Results do not depend on it");
  AddLimits(app, config);
  AddLogOptions(app, config);
  app.add_option("--simd", config.simd, "Instruction set of the episode kernel: auto, avx512, avx2 or baseline")
      ->envname("ORBITUNE_SIMD")
      ->check(CLI::IsMember({"auto", "avx512", "avx2", "baseline"}))
      ->capture_default_str();
  app.footer(
      "SIGTERM or SIGINT: unfinished jobs are kept and taken up at the next start.\n"
      "Exit status: 0 stopped by a signal, 1 could not start, 2 wrong usage.\n" +
      footer);
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
