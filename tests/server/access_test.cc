#include "server/access/access.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include <fstream>
#include <sstream>

#include "tests/server/engine_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;
using ::testing::Not;
using ::testing::Pair;
using ::testing::StartsWith;

std::int64_t Now() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// The server's side, and `orbituned token` as another process would be: through a store of its own.
class AccessTest : public testing::Test {
 protected:
  AccessTest() : console_(*AccessStore::Open(path())) {}

  std::string path() const { return directory_.File("access.db"); }

  void Open(AccessOptions options = {}) {
    options.period = std::chrono::milliseconds(10);
    auto access = Access::Open(path(), options);
    ASSERT_TRUE(access.ok()) << access.status();
    access_ = *std::move(access);
  }

  Secret AddToken(const std::string& name, Role role, std::int64_t expire_time_us = 0) {
    Secret secret = Secret::New();
    const absl::Status status = console_->AddToken({.id = secret.id,
                                                    .name = name,
                                                    .role = role,
                                                    .digest = secret.digest,
                                                    .create_time_us = Now(),
                                                    .expire_time_us = expire_time_us});
    EXPECT_TRUE(status.ok()) << status;
    return secret;
  }

  absl::StatusOr<Caller> Call(const std::string& token, const std::string& peer = "192.0.2.1") {
    return access_->Authenticate({.token = token, .session = {}, .peer = peer, .request_id = {}}, "Method");
  }
  absl::StatusOr<Caller> CallBySession(const std::string& session) {
    return access_->Authenticate({.token = {}, .session = session, .peer = "192.0.2.1", .request_id = {}}, "Method");
  }

  // Polls until it is so; fails the test where it takes minutes.
  void WaitUntil(const std::function<bool()>& condition) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (!condition()) {
      ASSERT_LT(std::chrono::steady_clock::now(), deadline);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  std::vector<AuditEntry> Entries() { return *console_->ListAudit({}); }

  // The message of what SQLite says to a statement.
  std::string Execute(const std::string& sql) {
    sqlite3* db = nullptr;
    sqlite3_open(path().c_str(), &db);
    sqlite3_busy_timeout(db, 10'000);
    char* message = nullptr;
    sqlite3_exec(db, sql.c_str(), nullptr, nullptr, &message);
    std::string said = message == nullptr ? "" : message;
    sqlite3_free(message);
    sqlite3_close(db);
    return said;
  }

  TemporaryDirectory directory_;
  const std::unique_ptr<AccessStore> console_;
  std::unique_ptr<Access> access_;
};

// What has ended while it lives: credential ids and reasons.
class EndedCredentials {
 public:
  explicit EndedCredentials(Access& access) : access_(access) {
    access_.OnCredentialEnd([this](const std::string& id, const absl::Status& why) {
      EXPECT_EQ(why.code(), absl::StatusCode::kUnauthenticated);
      const std::lock_guard lock(mutex_);
      EXPECT_TRUE(ended_.emplace(id, ReasonOf(why)).second) << id << " ended twice";
    });
  }
  ~EndedCredentials() { access_.OnCredentialEnd(nullptr); }

  std::map<std::string, std::string> Get() {
    const std::lock_guard lock(mutex_);
    return ended_;
  }

 private:
  Access& access_;
  std::mutex mutex_;
  std::map<std::string, std::string> ended_;  // guarded by mutex_
};

TEST_F(AccessTest, WithoutTokensEverybodyIsALocalAdminAndOwnsNothing) {
  Open();
  EXPECT_FALSE(access_->needs_token());
  const auto caller = Call("");
  ASSERT_TRUE(caller.ok());
  EXPECT_EQ(caller->name, "local");
  EXPECT_EQ(caller->role, Role::kAdmin);
  EXPECT_EQ(caller->owner(), "");
  EXPECT_NE(caller->request_id, Call("")->request_id);
}

TEST_F(AccessTest, ATokenSaysWhoAndWhat) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  EXPECT_TRUE(access_->needs_token());
  const auto caller = Call(secret.text);
  ASSERT_TRUE(caller.ok()) << caller.status();
  EXPECT_EQ(caller->name, "ana");
  EXPECT_EQ(caller->owner(), "ana");
  EXPECT_EQ(caller->role, Role::kOperator);
  EXPECT_EQ(caller->token_id, secret.id);
  EXPECT_EQ(caller->peer, "192.0.2.1");
}

TEST_F(AccessTest, WhatIsNoTokenOfOursIsRefusedAndNotRepeated) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  std::string other_end = secret.text;
  other_end.back() = other_end.back() == 'a' ? 'b' : 'a';
  EXPECT_EQ(ReasonOf(Call("").status()), "TOKEN_REQUIRED");
  for (const std::string& wrong : {other_end, secret.text.substr(1), secret.text + "a", Secret::New().text,
                                   std::string("orb_"), std::string("Basic YTpi"), std::string(100'000, 'x')}) {
    const absl::Status status = Call(wrong).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kUnauthenticated);
    EXPECT_EQ(ReasonOf(status), "TOKEN_INVALID");
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr(wrong)));
  }
}

TEST_F(AccessTest, ARunningServerNoticesNewTokensAndRevokedOnes) {
  Open();
  EXPECT_TRUE(Call("").ok());
  const Secret secret = AddToken("ana", Role::kViewer);
  WaitUntil([&] { return Call(secret.text).ok() && !Call("").ok(); });
  EndedCredentials ended(*access_);
  const auto caller = *Call(secret.text);
  ASSERT_TRUE(console_->RevokeTokens("ana", Now()).ok());
  WaitUntil([&] { return !Call(secret.text).ok(); });
  EXPECT_EQ(ReasonOf(Call(secret.text).status()), "TOKEN_REVOKED");
  EXPECT_EQ(ReasonOf(access_->StillValid(caller)), "TOKEN_REVOKED");
  WaitUntil([&] { return !ended.Get().empty(); });
  EXPECT_THAT(ended.Get(), ElementsAre(Pair(secret.id, "TOKEN_REVOKED")));
  // The last one revoked does not open the door.
  EXPECT_EQ(ReasonOf(Call("").status()), "TOKEN_REQUIRED");
  EXPECT_EQ(console_->RevokeTokens("ana", Now()).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(AccessTest, ATokenExpires) {
  const Secret secret = AddToken("ana", Role::kViewer, Now() + 200'000);
  const Secret past = AddToken("bob", Role::kViewer, Now() - 1);
  Open();
  EndedCredentials ended(*access_);
  EXPECT_EQ(ReasonOf(Call(past.text).status()), "TOKEN_EXPIRED");
  WaitUntil([&] { return ReasonOf(Call(secret.text).status()) == "TOKEN_EXPIRED" && !ended.Get().empty(); });
  EXPECT_THAT(ended.Get(), ElementsAre(Pair(secret.id, "TOKEN_EXPIRED")));
}

TEST_F(AccessTest, ASessionEndsWithItsTokenAndByLoggingOut) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  const auto session = access_->LogIn({.token = secret.text, .session = {}, .peer = "192.0.2.1", .request_id = {}});
  const auto other = access_->LogIn({.token = secret.text, .session = {}, .peer = "192.0.2.1", .request_id = {}});
  ASSERT_TRUE(session.ok() && other.ok());
  const Caller caller = *CallBySession(session->secret);
  const Caller another = *CallBySession(other->secret);
  EXPECT_TRUE(access_->StillValid(caller).ok());
  EndedCredentials ended(*access_);
  EXPECT_NE(session->secret, other->secret);
  EXPECT_THAT(session->secret, Not(HasSubstr(secret.text)));
  EXPECT_EQ(CallBySession(session->secret)->name, "ana");
  // A session is no token, nor a token a session.
  EXPECT_FALSE(Call(session->secret).ok());
  EXPECT_FALSE(CallBySession(secret.text).ok());
  access_->LogOut(session->secret);
  EXPECT_THAT(ended.Get(), ElementsAre(Pair(caller.credential_id(), "SESSION_ENDED")));
  EXPECT_EQ(ReasonOf(access_->StillValid(caller)), "SESSION_ENDED");
  EXPECT_TRUE(access_->StillValid(another).ok());
  EXPECT_EQ(ReasonOf(CallBySession(session->secret).status()), "SESSION_ENDED");
  EXPECT_TRUE(CallBySession(other->secret).ok());
  ASSERT_TRUE(console_->RevokeTokens(secret.id, Now()).ok());
  WaitUntil([&] { return !CallBySession(other->secret).ok() && ended.Get().size() == 3; });
  EXPECT_THAT(ended.Get(),
              IsSupersetOf({Pair(secret.id, "TOKEN_REVOKED"), Pair(another.credential_id(), "TOKEN_REVOKED")}));
}

TEST_F(AccessTest, ASessionEndsInTime) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open({.session_time = std::chrono::seconds(1)});
  const auto session = access_->LogIn({.token = secret.text, .session = {}, .peer = "192.0.2.1", .request_id = {}});
  ASSERT_TRUE(session.ok());
  EndedCredentials ended(*access_);
  WaitUntil([&] { return ReasonOf(CallBySession(session->secret).status()) == "SESSION_ENDED"; });
  WaitUntil([&] { return !ended.Get().empty(); });
  EXPECT_EQ(ended.Get().begin()->second, "SESSION_ENDED");
  EXPECT_TRUE(Call(secret.text).ok());
}

TEST_F(AccessTest, WhoIsWrongTooOftenIsToldToWaitAndWhoIsRightNever) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open({.failures_at_once = 3, .failures_per_s = 0});
  for (int i = 0; i < 3; ++i) EXPECT_EQ(Call("wrong").status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(Call("wrong").status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(CallBySession("wrong").status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(Call("").status().code(), absl::StatusCode::kUnauthenticated);  // these are no guesses
  EXPECT_TRUE(Call(secret.text).ok());
  EXPECT_EQ(Call("wrong", "192.0.2.2").status().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(AccessTest, TheSecretIsInNoFile) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  ASSERT_TRUE(Call(secret.text).ok());
  const auto session = access_->LogIn({.token = secret.text, .session = {}, .peer = "192.0.2.1", .request_id = {}});
  ASSERT_TRUE(session.ok());
  access_.reset();
  for (const char* const suffix : {"", "-wal"}) {
    std::ostringstream text;
    text << std::ifstream(path() + suffix).rdbuf();
    for (const std::string& hidden : {secret.text.substr(13), session->secret.substr(13)}) {
      EXPECT_EQ(text.str().find(hidden), std::string::npos) << suffix;
    }
  }
  struct stat about {};
  ASSERT_EQ(stat(path().c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600U);
}

TEST_F(AccessTest, TellsWhenATokenWasLastUsed) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  ASSERT_TRUE(Call(secret.text).ok());
  WaitUntil([&] { return console_->ListTokens()->front().last_used_time_us > 0; });
}

TEST_F(AccessTest, WhatWasDoneIsOnDiskWhenItIsSaid) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  access_->Audit(*Call(secret.text), "orbitune.v1.TuningService.CreateJob", "jobs/a");
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].caller, "ana");
  EXPECT_EQ(entries[0].role, "operator");
  EXPECT_EQ(entries[0].token_id, secret.id);
  EXPECT_EQ(entries[0].peer, "192.0.2.1");
  EXPECT_EQ(entries[0].method, "orbitune.v1.TuningService.CreateJob");
  EXPECT_EQ(entries[0].resource, "jobs/a");
  EXPECT_EQ(entries[0].outcome, "OK");
  EXPECT_EQ(entries[0].count, 1);
  EXPECT_NEAR(static_cast<double>(entries[0].time_us), static_cast<double>(Now()), 60e6);
}

TEST_F(AccessTest, ManyAtOnceAreAllThere) {
  Open();
  std::vector<std::jthread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 50; ++i) {
        access_->Audit(LocalCaller("192.0.2.1"), "Method", std::to_string(t) + "/" + std::to_string(i));
      }
    });
  }
  threads.clear();
  std::set<std::string> resources;
  for (const AuditEntry& entry : Entries()) resources.insert(entry.resource);
  EXPECT_EQ(resources.size(), 200u);
}

TEST_F(AccessTest, WhatIsOldLeavesTheAuditLogFromTheFrontAndIsCounted) {
  constexpr std::int64_t kDayUs = 86'400'000'000;
  std::vector<AuditEntry> entries;
  for (const std::int64_t age_days : {40, 35, 31, 29, 33, 1}) {  // the last but one by a clock that was wrong
    entries.push_back({.time_us = Now() - age_days * kDayUs, .caller = "ana", .method = "Method", .outcome = "OK"});
  }
  ASSERT_TRUE(console_->Append(entries).ok());
  Open();
  EXPECT_EQ(Entries().size(), 6u);  // for ever, unless asked for
  Open({.retain_audit_days = 30});
  WaitUntil([&] { return Entries().back().method == "audit retention"; });
  const auto left = Entries();
  ASSERT_EQ(left.size(), 4u);
  for (std::size_t i = 0; i < left.size(); ++i) EXPECT_EQ(left[i].number, static_cast<std::int64_t>(i) + 4);
  EXPECT_EQ(left.back().caller, "orbituned");
  EXPECT_EQ(left.back().resource, "auditEntries/1 to 3");
  EXPECT_EQ(left.back().count, 3);
  // Nothing but this removes any, now as before; and nothing goes twice.
  EXPECT_EQ(Execute("DELETE FROM audit_log"), "the audit log is append-only");
  Open({.retain_audit_days = 30});
  access_->Audit(LocalCaller("192.0.2.1"), "Method", "");
  EXPECT_EQ(Entries().size(), 5u);
}

TEST_F(AccessTest, OldAuditEntriesGoAFewAtATime) {
  ASSERT_TRUE(console_->Append(std::vector<AuditEntry>(10, {.time_us = 1})).ok());
  EXPECT_EQ(*console_->RemoveOldestAudit(2, 4, 100), 4);
  EXPECT_EQ(*console_->RemoveOldestAudit(1, 4, 100), 0);
  EXPECT_EQ(*console_->RemoveOldestAudit(2, 100, 100), 6);
  EXPECT_EQ(*console_->RemoveOldestAudit(2, 100, 100), 0);
  const auto left = Entries();
  ASSERT_EQ(left.size(), 2u);
  EXPECT_EQ(left[0].resource, "auditEntries/1 to 4");
  EXPECT_EQ(left[1].resource, "auditEntries/5 to 10");
}

TEST_F(AccessTest, TheAuditLogIsAppendOnlyAndTokensStayRevoked) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open();
  access_->Audit(*Call(secret.text), "Method", "jobs/a");
  ASSERT_TRUE(console_->RevokeTokens("ana", Now()).ok());
  const auto before = Entries();
  for (const char* const sql : {"DELETE FROM audit_log", "UPDATE audit_log SET caller = 'bob'",
                                "INSERT OR REPLACE INTO audit_log SELECT number, 0, '', '', '', '', '', '', '', '', 1 "
                                "FROM audit_log"}) {
    EXPECT_EQ(Execute(sql), "the audit log is append-only") << sql;
  }
  EXPECT_THAT(Execute("DELETE FROM tokens"), HasSubstr("revoked, not deleted"));
  EXPECT_THAT(Execute("UPDATE tokens SET role = 'admin'"), HasSubstr("does not change"));
  EXPECT_THAT(Execute("UPDATE tokens SET revoke_time_us = 0"), HasSubstr("stays revoked"));
  ASSERT_EQ(Entries().size(), before.size());
  EXPECT_EQ(Entries()[0].caller, "ana");
}

TEST_F(AccessTest, RefusalsAreCountedNotListed) {
  const Secret secret = AddToken("ana", Role::kOperator);
  Open({.failures_at_once = 1e9});
  for (int i = 0; i < 500; ++i) {
    (void)Call("wrong");
    access_->AuditRefusal(*Call(secret.text), "Delete", "jobs/a", absl::PermissionDeniedError("no"));
  }
  // Many kinds share an entry.
  for (int i = 0; i < 500; ++i) (void)Call("wrong", "192.0.2." + std::to_string(i));
  access_.reset();
  std::map<std::string, std::int64_t> count;
  const auto entries = Entries();
  for (const AuditEntry& entry : entries) count[entry.outcome] += entry.count;
  EXPECT_EQ(count["PERMISSION_DENIED"], 500);
  EXPECT_EQ(count["UNAUTHENTICATED"] + count["various"], 1000);
  EXPECT_LE(entries.size(), 2u * 17);
}

TEST_F(AccessTest, WhileTheAuditLogCannotBeWrittenNothingIsToBeChanged) {
  Open();
  EXPECT_TRUE(access_->AuditReady().ok());
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  access_->Audit(LocalCaller("192.0.2.1"), "Method", "jobs/a");  // returns, though the disk does not take it
  EXPECT_EQ(access_->AuditReady().code(), absl::StatusCode::kUnavailable);
  ASSERT_EQ(sqlite3_exec(db, "ROLLBACK", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  WaitUntil([&] { return access_->AuditReady().ok(); });
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].resource, "jobs/a");
}

TEST_F(AccessTest, RefusesAnothersFileAndANewerOne) {
  Execute("PRAGMA user_version = 99");
  EXPECT_THAT(std::string(Access::Open(path()).status().message()), HasSubstr("newer"));
  const std::string other = directory_.File("other.db");
  std::ofstream(other) << "this is no database, and long enough to be sure about it: " << std::string(200, '.');
  EXPECT_EQ(Access::Open(other).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Access::Open(directory_.File("no/such/access.db")).status().code(), absl::StatusCode::kUnavailable);
}

TEST(Secret, IsRecognisableAndNeverTheSame) {
  const Secret a = Secret::New();
  const Secret b = Secret::New();
  EXPECT_THAT(a.text, StartsWith("orb_"));
  EXPECT_EQ(a.text.size(), 65u);
  EXPECT_NE(a.text, b.text);
  EXPECT_NE(a.id, b.id);
  EXPECT_EQ(SecretId(a.text), a.id);
  EXPECT_EQ(SecretId("orb_short"), std::nullopt);
  EXPECT_TRUE(HasDigest(a.text, a.digest));
  EXPECT_FALSE(HasDigest(b.text, a.digest));
  EXPECT_FALSE(HasDigest(a.text, ""));
}

}  // namespace
}  // namespace orbitune::server_test
