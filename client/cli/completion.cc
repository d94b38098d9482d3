#include "client/cli/completion.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace orbitune::cli {
namespace {

constexpr char kHead[] = R"sh(# bash completion for orbitune; written by `orbitune completion bash`.
_orbitune_names() {
  orbitune --timeout 2 "$@" 2>/dev/null | awk 'NR > 1 { print $1 }'
}

_orbitune_complete() {
  local kind=$1 current=$2 words=''
  case $kind in
    FILE)
      mapfile -t COMPREPLY < <(compgen -f -- "$current")
      compopt -o filenames 2>/dev/null
      return ;;
    JOB)
      words=$(_orbitune_names jobs --limit 100)
      [[ $current == j* ]] || words=${words//jobs\//} ;;
    SCENARIO)
      words=$(_orbitune_names scenarios)
      [[ $current == scenarios/* ]] || words=${words//scenarios\//} ;;
    *[[:upper:]]*) ;;
    *) words=${kind//|/ } ;;
  esac
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
}

_orbitune() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]}
  local command='' kind='' flags='' words='' positional='' i
)sh";

constexpr char kTail[] = R"sh(  if [[ -n $kind ]]; then
    _orbitune_complete "$kind" "$current"
  elif [[ $current != -* && -n $positional ]]; then
    _orbitune_complete "$positional" "$current"
  else
    [[ $current == -* ]] && words=$flags
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
  fi
}
complete -F _orbitune orbitune
)sh";

// A branch of a `case`, up to its commands.
std::string Pattern(const std::vector<std::string>& words) {
  return absl::StrCat("    ", absl::StrJoin(words, "|"), ") ");
}

// Which kind of value the word before asks for.
std::string ValueCases(const CommandSpec& command) {
  std::string cases;
  for (const OptionSpec& option : command.options) {
    if (option.flags.empty() || option.value.empty()) continue;
    std::vector<std::string> patterns;
    for (const std::string& flag : option.flags) {
      patterns.push_back(absl::StrCat(command.name.empty() ? "*" : command.name, ":", flag));
    }
    absl::StrAppend(&cases, Pattern(patterns), "kind='", option.value, "' ;;\n");
  }
  return cases;
}

std::string Flags(const CommandSpec& command) {
  std::vector<std::string> flags;
  for (const OptionSpec& option : command.options) {
    for (const std::string& flag : option.flags) {
      if (absl::StartsWith(flag, "--")) flags.push_back(flag);
    }
  }
  return absl::StrJoin(flags, " ");
}

std::string Positional(const CommandSpec& command) {
  for (const OptionSpec& option : command.options) {
    if (option.flags.empty()) return option.value;
  }
  return "";
}

}  // namespace

std::string BashCompletion(const std::vector<CommandSpec>& commands) {
  std::vector<std::string> names;
  std::string values, flags;
  for (const CommandSpec& command : commands) {
    absl::StrAppend(&values, ValueCases(command));
    if (command.name.empty()) continue;
    names.push_back(command.name);
    absl::StrAppend(&flags, Pattern({command.name}), "flags='", Flags(command), " ", Flags(commands.front()),
                    "' positional='", Positional(command), "' ;;\n");
  }
  return absl::StrCat(kHead, "  for ((i = 1; i < COMP_CWORD; ++i)); do\n    case ${COMP_WORDS[i]} in\n  ",
                      Pattern(names),
                      "command=${COMP_WORDS[i]}; break ;;\n    esac\n  done\n",  //
                      "  case $command:$previous in\n", values, "  esac\n",      //
                      "  case $command in\n", flags, "    *) flags='", Flags(commands.front()), "' words='",
                      absl::StrJoin(names, " "), "' ;;\n  esac\n", kTail);
}

}  // namespace orbitune::cli
