// `orbituned COMMAND ...`: what is done to a data directory, beside its server or without one, and ends.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace orbitune {

struct Command {
  std::string_view name;
  std::string_view summary;  // a line of the help
  // argv[0]: the name. Returns the exit status: 0, 1 it failed, 2 wrong usage.
  int (*run)(int argc, char** argv);
};

// In the order of the help. Another command: a line here, and a file of its own beside this one.
std::span<const Command> Commands();

// Their part of the server's help.
std::string CommandsHelp();

// nullptr for none: an option of the server.
const Command* FindCommand(std::string_view name);

}  // namespace orbitune
