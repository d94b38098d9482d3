// Who may call, and who did what: tokens, the dashboard's sessions, how often an address may be wrong, the audit log.
// Tokens are looked up in memory; a thread of its own reads them again when `orbituned token` has changed them, and
// writes the audit log, whatever comes together in one commit.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <set>
#include <thread>
#include <tuple>
#include <unordered_map>

#include "server/access/caller.h"
#include "server/access/secret.h"

namespace orbitune {

struct AccessOptions {
  double failures_at_once = 20;  // wrong tokens from one address until it is told to wait
  double failures_per_s = 1;     // that it may go on with
  std::chrono::seconds session_time{12 * 3600};
  std::chrono::milliseconds period{500};   // within which a change of the tokens is noticed
  std::chrono::seconds refusals_time{60};  // refusals alike within it are one entry of the audit log
  double retain_audit_days = 0;            // entries older than it go, within a day; 0: they are kept for ever
};

// What came with a request.
struct Credentials {
  std::string_view token;    // empty: none; whatever was there in its place, else
  std::string_view session;  // the dashboard's cookie; counts where there is no token
  std::string peer;
  std::string request_id;  // empty: one is made up
};

// Thread-safe.
class Access {
 public:
  // Opens the store at `path`, or says why it cannot.
  static absl::StatusOr<std::unique_ptr<Access>> Open(const std::string& path, AccessOptions options = {});
  ~Access();  // writes what is left of the audit log

  // Whether there are tokens, revoked ones too: whoever calls then needs one. Else everybody is a local admin.
  bool needs_token() const;

  // Who it is that calls `method`. UNAUTHENTICATED without a valid token; RESOURCE_EXHAUSTED instead where the address
  // has been wrong too often: a token that is right is always taken, for nobody guesses 256 bits, and shutting out an
  // address would shut out all behind it.
  absl::StatusOr<Caller> Authenticate(const Credentials& credentials, std::string_view method);

  // OK, or why the token or session that the caller came with is valid no more: UNAUTHENTICATED.
  absl::Status StillValid(const Caller& caller) const;

  struct Session {
    std::string secret;  // the cookie's value
    Caller caller;
    std::chrono::seconds time;  // it lasts, unless its token ends before
  };
  // By a token; without one where none is needed. Errors as Authenticate's.
  absl::StatusOr<Session> LogIn(const Credentials& credentials);
  void LogOut(std::string_view session);

  // Calls `ended` with the id of every token and session that ceases to be valid (Caller::credential_id), and why,
  // until it is set again; nullptr: nobody. The sessions of a token end with it.
  using CredentialEnd = std::function<void(const std::string& credential_id, const absl::Status& why)>;
  void OnCredentialEnd(CredentialEnd ended);

  // UNAVAILABLE while the audit log cannot be written: then nothing must be changed.
  absl::Status AuditReady() const;
  // Notes what was done; on disk when it returns, unless the disk has just failed: then as soon as it is back.
  void Audit(const Caller& caller, std::string_view method, std::string_view resource);
  // Counts what was refused or failed; it is written within a second or so.
  void AuditRefusal(const Caller& caller, std::string_view method, std::string_view resource,
                    const absl::Status& refusal);
  absl::StatusOr<std::vector<AuditEntry>> ListAudit(const AuditQuery& query) { return store_->ListAudit(query); }

 private:
  struct LiveSession {
    std::string digest;
    std::string token_id;
    std::int64_t expire_time_us;

    bool ValidAt(std::int64_t now_us) const { return now_us < expire_time_us; }
  };
  struct Bucket {
    double left;
    std::int64_t time_us;
  };
  // Caller's name, token, address; method; outcome.
  using RefusalKey = std::tuple<std::string, std::string, std::string, std::string, std::string>;
  struct Refusals {
    AuditEntry first;  // of those not yet written
    std::int64_t unwritten = 0;
    bool written = false;  // in this window
  };

  Access(std::unique_ptr<AccessStore> store, AccessOptions options);

  absl::StatusOr<Caller> Find(const Credentials& credentials) const;         // under mutex_
  absl::StatusOr<std::string> SessionId(std::string_view session) const;     // under mutex_; of one that lasts
  absl::Status CheckToken(const std::string& id) const;                      // under mutex_
  absl::Status Failed(const Credentials& credentials, absl::Status status);  // under mutex_
  void Count(AuditEntry entry);                                              // under mutex_
  void QueueRefusals(bool all);                                              // under mutex_
  void Loop();
  void WriteAudit(std::unique_lock<std::mutex>& lock);
  void WriteUse(std::unique_lock<std::mutex>& lock);
  void RemoveOldAudit(std::unique_lock<std::mutex>& lock);
  absl::Status Load(std::unique_lock<std::mutex>& lock);
  std::map<std::string, absl::Status> NewlyEnded();             // under mutex_; by credential, why
  void Tell(const std::map<std::string, absl::Status>& ended);  // not under mutex_

  // Constant after construction.
  const std::unique_ptr<AccessStore> store_;
  const AccessOptions options_;
  const std::string request_prefix_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;     // the thread
  std::condition_variable written_;  // who waits for the audit log
  // Guarded by mutex_.
  std::unordered_map<std::string, TokenRecord> tokens_;
  std::set<std::string> valid_;  // ids of tokens, as last looked
  std::map<std::string, LiveSession, std::less<>> sessions_;
  std::unordered_map<std::string, Bucket> buckets_;
  std::map<std::string, std::int64_t> used_us_;  // to be written
  std::deque<AuditEntry> queue_;
  std::uint64_t queued_entries_ = 0;
  std::uint64_t tried_entries_ = 0;  // written, or the disk failed
  absl::Status audit_status_;
  std::map<RefusalKey, Refusals> refusals_;
  std::int64_t refusals_since_us_ = 0;
  std::uint64_t requests_ = 0;
  std::int64_t foreign_changes_ = -1;
  std::chrono::steady_clock::time_point next_removal_;
  bool ending_ = false;

  std::mutex ended_mutex_;  // before mutex_, never the other way round
  CredentialEnd ended_;     // guarded by ended_mutex_

  std::thread thread_;
};

}  // namespace orbitune
