#include "server/commands/commands.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/status.h"
#include "server/commands/audit.h"
#include "server/commands/backup.h"
#include "server/commands/token.h"

namespace orbitune {
namespace {

constexpr Command kCommands[] = {
    {"token", "Make, list and revoke the tokens that clients need", RunToken},
    {"audit", "Who did what, as a table, JSON or CSV", RunAudit},
    {"backup", "Copy the database, while the server runs", RunBackup},
    {"restore", "Put a backup in the database's place, while no server runs", RunRestore},
    {"check", "Look for damage in the database, or in a backup", RunCheck},
};

}  // namespace

std::span<const Command> Commands() { return kCommands; }

std::string CommandsHelp() {
  std::string help = "\nCommands, each with a --help of its own; a running server is not disturbed:\n";
  for (const Command& command : Commands()) {
    absl::StrAppend(&help,
                    absl::StrFormat("  orbituned %-8s %s\n", std::string(command.name), std::string(command.summary)));
  }
  return help;
}

const Command* FindCommand(std::string_view name) {
  const auto commands = Commands();
  const auto found = std::ranges::find(commands, name, &Command::name);
  return found == commands.end() ? nullptr : &*found;
}

}  // namespace orbitune
