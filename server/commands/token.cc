#include "server/commands/token.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "server/access/caller.h"
#include "server/access/secret.h"
#include "server/commands/support.h"
#include "server/config/config.h"

namespace orbitune {
namespace {

constexpr std::int64_t kUsPerDay = 86'400'000'000;

struct Options {
  std::string data_dir = DefaultDataDir();
  std::string name;
  std::string role;
  int expires_days = 0;  // 0: never
  bool json = false;
  std::string revoked;  // id or name
};

absl::Status CheckName(const std::string& name) {
  const bool usable =
      !name.empty() && name.size() <= 64 &&
      name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._@-") == std::string::npos;
  if (usable && name != kLocalName && name != "console") return absl::OkStatus();
  return InvalidOption("--name", "1 to 64 of letters, digits, . _ @ -, and neither \"local\" nor \"console\"", name);
}

absl::Status Note(AccessStore& store, const char* method, const TokenRecord& token) {
  const AuditEntry entry{.time_us = NowUs(),
                         .caller = "console",
                         .role = std::string(NameOf(Role::kAdmin)),
                         .method = method,
                         .resource = absl::StrCat("tokens/", token.id, " (", token.name, ")"),
                         .outcome = "OK"};
  return store.Append({&entry, 1});
}

absl::Status Create(AccessStore& store, const Options& options) {
  if (absl::Status status = CheckName(options.name); !status.ok()) return status;
  const Secret secret = Secret::New();
  const std::int64_t now_us = NowUs();
  const TokenRecord token{.id = secret.id,
                          .name = options.name,
                          .role = *RoleOf(options.role),
                          .digest = secret.digest,
                          .create_time_us = now_us,
                          .expire_time_us = options.expires_days == 0 ? 0 : now_us + options.expires_days * kUsPerDay};
  absl::Status status = store.AddToken(token);
  if (status.ok()) status = Note(store, "token create", token);
  if (!status.ok()) return status;
  // The secret alone goes to standard output, into a pipe or a file.
  std::fprintf(stderr, "token %s: %s, %s, expires %s. It is shown this once:\n", token.id.c_str(), token.name.c_str(),
               options.role.c_str(), FormatTime(token.expire_time_us).c_str());
  std::printf("%s\n", secret.text.c_str());
  return absl::OkStatus();
}

const char* StateOf(const TokenRecord& token) {
  if (token.revoke_time_us != 0) return "revoked";
  return token.ValidAt(NowUs()) ? "valid" : "expired";
}

nlohmann::ordered_json ToJson(const TokenRecord& token) {
  const auto time = [](std::int64_t us) -> nlohmann::ordered_json {
    if (us == 0) return nullptr;
    return FormatTime(us);
  };
  return {{"id", token.id},
          {"name", token.name},
          {"role", NameOf(token.role)},
          {"state", StateOf(token)},
          {"create_time", time(token.create_time_us)},
          {"expire_time", time(token.expire_time_us)},
          {"revoke_time", time(token.revoke_time_us)},
          {"last_used_time", time(token.last_used_time_us)}};
}

absl::Status List(AccessStore& store, const Options& options) {
  const auto tokens = store.ListTokens();
  if (!tokens.ok()) return tokens.status();
  if (options.json) {
    auto list = nlohmann::ordered_json::array();
    for (const TokenRecord& token : *tokens) list.push_back(ToJson(token));
    std::printf("%s\n", list.dump(2).c_str());
    return absl::OkStatus();
  }
  std::vector<std::vector<std::string>> rows = {{"ID", "NAME", "ROLE", "STATE", "CREATED", "EXPIRES", "LAST USED"}};
  for (const TokenRecord& token : *tokens) {
    rows.push_back({token.id, token.name, std::string(NameOf(token.role)), StateOf(token),
                    FormatTime(token.create_time_us), FormatTime(token.expire_time_us),
                    FormatTime(token.last_used_time_us)});
  }
  std::printf("%s", FormatTable(rows).c_str());
  return absl::OkStatus();
}

absl::Status Revoke(AccessStore& store, const Options& options) {
  const auto revoked = store.RevokeTokens(options.revoked, NowUs());
  if (!revoked.ok()) return revoked.status();
  for (const TokenRecord& token : *revoked) {
    if (absl::Status status = Note(store, "token revoke", token); !status.ok()) return status;
    std::printf("revoked %s (%s, %s)\n", token.id.c_str(), token.name.c_str(), std::string(NameOf(token.role)).c_str());
  }
  return absl::OkStatus();
}

using Act = absl::Status (*)(AccessStore&, const Options&);

void AddCommands(CLI::App& app, Options& options, Act& act) {
  app.require_subcommand(1);
  app.add_option("--data-dir", options.data_dir, "The server's")->envname("ORBITUNE_DATA_DIR")->capture_default_str();
  app.fallthrough();
  CLI::App* const create = app.add_subcommand("create", "Make a token, and show it once");
  create->add_option("--name", options.name, "Whose it is: what it creates is owned by this name")->required();
  create->add_option("--role", options.role, "viewer: reads; operator: creates, and steers what is its own; admin: all")
      ->required()
      ->check(CLI::IsMember({"viewer", "operator", "admin"}));
  create->add_option("--expires-days", options.expires_days, "[never]")->check(CLI::Range(1, 3650));
  create->callback([&act] { act = Create; });
  CLI::App* const list = app.add_subcommand("list", "List all tokens, never their secrets");
  list->add_flag("--json", options.json, "As JSON");
  list->callback([&act] { act = List; });
  CLI::App* const revoke = app.add_subcommand("revoke", "Revoke a token, or all of a name; a server notices at once");
  revoke->add_option("TOKEN", options.revoked, "Its id, or a name")->required();
  revoke->callback([&act] { act = Revoke; });
}

}  // namespace

int RunToken(int argc, char** argv) {
  Options options;
  Act act = nullptr;
  CLI::App app("Tokens, which clients send with every call. A server with no token at all lets everybody in.",
               "orbituned token");
  AddCommands(app, options, act);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const auto store = OpenAccessStore(options.data_dir);
  const absl::Status status = store.ok() ? act(**store, options) : store.status();
  return status.ok() ? 0 : FailCommand(status);
}

}  // namespace orbitune
