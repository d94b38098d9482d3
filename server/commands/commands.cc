#include "server/commands/commands.h"

#include <algorithm>

namespace orbitune {

std::span<const Command> Commands() { return {}; }

const Command* FindCommand(std::string_view name) {
  const auto commands = Commands();
  const auto found = std::ranges::find(commands, name, &Command::name);
  return found == commands.end() ? nullptr : &*found;
}

}  // namespace orbitune
