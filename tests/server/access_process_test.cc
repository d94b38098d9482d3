// The binaries: tokens made and revoked beside a running server, what it prints, and what it refuses to listen on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "tests/server/engine_support.h"
#include "tests/server/process_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

class AccessProcessTest : public testing::Test {
 protected:
  struct Result {
    int code;
    std::string out;
    std::string err;
  };
  Result Run(std::vector<std::string> command, const std::vector<std::string>& environment = {}) {
    Process process(directory_.File("run" + std::to_string(++runs_)), std::move(command), environment);
    const int code = process.Wait();
    return {code, process.out(), process.err()};
  }
  std::string data() const { return directory_.File("data"); }

  // `orbituned token ...` on the data directory.
  Result Token(const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {"token"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    command.insert(command.end(), {"--data-dir", data()});
    return Run(ServerCommand(command));
  }
  std::string CreateToken(const std::string& name, const std::string& role) {
    const Result created = Token({"create", "--name", name, "--role", role});
    EXPECT_EQ(created.code, 0) << created.err;
    EXPECT_THAT(created.out, StartsWith("orb_"));
    return created.out.substr(0, created.out.find('\n'));
  }
  Result Cli(const Server& server, std::vector<std::string> arguments, const std::string& token) {
    arguments.insert(arguments.begin(), {ORBITUNE_CLI, "--server", server.address()});
    return Run(std::move(arguments),
               token.empty() ? std::vector<std::string>() : std::vector<std::string>{"ORBITUNE_TOKEN=" + token});
  }
  Result Audit(const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {"audit", "--data-dir", data()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return Run(ServerCommand(command));
  }
  std::vector<std::string> ServerArguments() const { return {"--data-dir", data(), "--listen", "127.0.0.1:0"}; }

  TemporaryDirectory directory_;
  int runs_ = 0;
};

TEST_F(AccessProcessTest, TokensAreMadeListedAndRevokedBesideTheServer) {
  Server server(directory_.File("server"), ServerArguments());
  EXPECT_THAT(server.process().out(), HasSubstr("access everybody is an admin, for there are no tokens, in the clear"));
  EXPECT_THAT(Cli(server, {"whoami"}, "").out, HasSubstr("local, admin"));
  const std::string token = CreateToken("ana", "operator");
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (Cli(server, {"whoami"}, "").code == 0 && std::chrono::steady_clock::now() < deadline) {
  }
  const Result without = Cli(server, {"whoami"}, "");
  EXPECT_EQ(without.code, 7);
  EXPECT_THAT(without.err, AllOf(HasSubstr("UNAUTHENTICATED"), HasSubstr("needs a token")));
  EXPECT_EQ(Cli(server, {"whoami"}, token).out, "ana, operator\n");
  const Result created = Cli(server, {"submit", "--scenario", "leo-rendezvous", "--iterations", "1"}, token);
  EXPECT_EQ(created.code, 0) << created.err;

  const Result list = Token({"list"});
  EXPECT_THAT(list.out, AllOf(HasSubstr("ana"), HasSubstr("operator"), HasSubstr("valid"), Not(HasSubstr(token))));
  EXPECT_EQ(Token({"revoke", "ana"}).code, 0);
  EXPECT_EQ(Token({"revoke", "ana"}).code, 1);
  while (Cli(server, {"whoami"}, token).code == 0 && std::chrono::steady_clock::now() < deadline) {
  }
  EXPECT_THAT(Cli(server, {"whoami"}, token).err, HasSubstr("the token was revoked"));
  EXPECT_THAT(Token({"list", "--json"}).out, HasSubstr("\"state\": \"revoked\""));

  const Result audit = Audit({"--json"});
  EXPECT_THAT(audit.out, AllOf(HasSubstr("token create"), HasSubstr("TuningService.CreateJob"),
                               HasSubstr("token revoke"), HasSubstr("\"caller\":\"ana\"")));
  EXPECT_THAT(LinesOf(Audit({"--csv"}).out), SizeIs(LinesOf(audit.out).size() + 1));
  EXPECT_THAT(LinesOf(Audit({"--since", "2100-01-01"}).out), SizeIs(1));
  EXPECT_EQ(Audit({"--since", "yesterday"}).code, 2);

  EXPECT_EQ(server.Terminate(), 0);
  // What was printed anywhere has the secret nowhere, but for the one time.
  const std::string secret = token.substr(13);
  for (const std::string& text : {server.process().out(), server.process().err(), list.out, audit.out, without.err}) {
    EXPECT_THAT(text, Not(HasSubstr(secret)));
  }
}

TEST_F(AccessProcessTest, ATokenComesFromAFileThatNobodyElseReads) {
  const std::string token = CreateToken("ana", "viewer");
  Server server(directory_.File("server"), ServerArguments());
  const std::string file = directory_.File("token");
  std::ofstream(file) << token << "\n";
  chmod(file.c_str(), 0644);
  const Result open = Cli(server, {"whoami", "--token-file", file}, "");
  EXPECT_EQ(open.code, 2);
  EXPECT_THAT(open.err, AllOf(HasSubstr("chmod 600"), HasSubstr("0644"), Not(HasSubstr(token))));
  chmod(file.c_str(), 0600);
  EXPECT_EQ(Cli(server, {"whoami", "--token-file", file}, "").out, "ana, viewer\n");
  EXPECT_EQ(Cli(server, {"whoami"}, "or b_").code, 2);
}

TEST_F(AccessProcessTest, ATokenDoesNotCrossANetworkInTheClear) {
  const Result refused =
      Run({ORBITUNE_CLI, "--server", "192.0.2.1:7313", "whoami"}, {"ORBITUNE_TOKEN=orb_abcd2345_secret"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("in the clear"), HasSubstr("https://"), Not(HasSubstr("orb_abcd"))));
}

TEST_F(AccessProcessTest, BadTokensAreRefusedByName) {
  EXPECT_EQ(Token({}).code, 2);
  EXPECT_EQ(Token({"create", "--name", "ana"}).code, 2);
  EXPECT_EQ(Token({"create", "--name", "ana", "--role", "king"}).code, 2);
  EXPECT_EQ(Token({"create", "--name", "ana", "--role", "viewer", "--expires-days", "0"}).code, 2);
  for (const char* const name : {"", "local", "console", "a b", "a\nb"}) {
    const Result result = Token({"create", "--name", name, "--role", "viewer"});
    EXPECT_EQ(result.code, 2) << name;
  }
  EXPECT_EQ(Token({"revoke", "nobody"}).code, 1);
}

TEST_F(AccessProcessTest, AnOpenAddressNeedsTlsAndTokens) {
  for (const char* const option : {"--listen", "--http"}) {
    const Result refused = Run(ServerCommand({"--data-dir", data(), option, "0.0.0.0:0"}));
    EXPECT_EQ(refused.code, 1);
    EXPECT_THAT(refused.err, AllOf(HasSubstr(std::string(option) + " 0.0.0.0:0"), HasSubstr("neither TLS nor tokens"),
                                   HasSubstr("127.0.0.1"), HasSubstr("--tls-cert"), HasSubstr("orbituned token create"),
                                   HasSubstr("--insecure")));
  }
  CreateToken("ana", "admin");
  EXPECT_THAT(Run(ServerCommand({"--data-dir", data(), "--listen", "[::]:0"})).err, HasSubstr("there is no TLS"));
  Server server(directory_.File("server"), {"--data-dir", data(), "--listen", "0.0.0.0:0", "--insecure"});
  EXPECT_EQ(server.Terminate(), 0);
}

}  // namespace
}  // namespace orbitune::server_test
