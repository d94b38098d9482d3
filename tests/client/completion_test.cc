#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/client/fake_server.h"

namespace orbitune::cli {
namespace {

class Completion : public testing::Test {
 protected:
  Completion() {
    const FakeServer::Result result = RunClient({"completion", "bash"});
    EXPECT_EQ(result.code, 0) << result.err;
    std::ofstream(script_) << result.out;
  }
  ~Completion() override { std::filesystem::remove(script_); }

  // What bash offers for the last of the words; `orbitune` itself is replaced by a function.
  std::string Complete(const std::string& words) const {
    const std::string command =
        "bash -c 'orbitune() { echo NAME; [[ \" $* \" == *\" scenarios\"* ]] && echo scenarios/gto-geo || "
        "echo jobs/4f1c; }; source " +
        script_ + "; COMP_WORDS=(" + words +
        "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _orbitune; echo \"${COMPREPLY[@]}\"'";
    FILE* const pipe = popen(command.c_str(), "r");
    std::string output;
    std::array<char, 256> buffer{};
    while (fgets(buffer.data(), buffer.size(), pipe) != nullptr) output += buffer.data();
    pclose(pipe);
    return output.substr(0, output.find('\n'));
  }

  const std::string script_ = testing::TempDir() + "orbitune_completion_" + std::to_string(getpid());
};

TEST_F(Completion, IsValidBash) { EXPECT_EQ(std::system(("bash -n " + script_).c_str()), 0); }

TEST_F(Completion, OffersCommandsOptionsAndNames) {
  EXPECT_EQ(Complete("orbitune s"), "scenarios submit show simulate");
  EXPECT_EQ(Complete("orbitune --json submit --initial-g"), "--initial-gains");
  EXPECT_EQ(Complete("orbitune history --format c"), "csv");
  EXPECT_EQ(Complete("orbitune completion b"), "bash");
  EXPECT_EQ(Complete("orbitune submit --scenario gto"), "gto-geo");
  EXPECT_EQ(Complete("orbitune watch 4"), "4f1c");
  EXPECT_EQ(Complete("orbitune cancel jobs/"), "jobs/4f1c");
  EXPECT_EQ(Complete("orbitune submit --iterations 1"), "");
}

}  // namespace
}  // namespace orbitune::cli
