#include "server/access/access.h"

#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "core/base/clock.h"
#include "server/log/log.h"

namespace orbitune {
namespace {

constexpr std::int64_t kUsPerS = 1'000'000;
constexpr std::int64_t kUseResolutionUs = 60 * kUsPerS;
constexpr std::size_t kMostSessions = 4096;
constexpr std::size_t kMostBuckets = 4096;
// Refusals of so many kinds have an entry of their own in each window; the rest share one, so that no flood of them
// fills the disk.
constexpr std::size_t kMostRefusalKinds = 16;
constexpr std::size_t kLongestText = 200;  // of what comes from outside, in the audit log
// Old entries are removed once a day, each time with an entry that says so; a few at a time, for who waits for one.
constexpr std::chrono::hours kBetweenRemovals{24};
constexpr int kMostRemoved = 5000;

absl::Status Unauthenticated(std::string_view text, std::string_view reason) {
  return WithReason(absl::UnauthenticatedError(ToAbsl(text)), reason);
}

absl::Status SessionEnded() { return Unauthenticated("the session has ended: log in again", "SESSION_ENDED"); }

std::string Shortened(std::string_view text) { return std::string(text.substr(0, kLongestText)); }

AuditEntry EntryOf(const Caller& caller, std::string_view method, std::string_view resource,
                   const absl::Status& outcome) {
  return {.time_us = NowUs(),
          .caller = caller.name,
          .role = caller.role == Role::kNone ? "" : std::string(NameOf(caller.role)),
          .token_id = caller.token_id,
          .peer = caller.peer,
          .method = Shortened(method),
          .resource = Shortened(resource),
          .outcome = absl::StatusCodeToString(outcome.code()),
          .request_id = caller.request_id};
}

Caller CallerOf(const TokenRecord& token, const Credentials& credentials) {
  return {.name = token.name,
          .role = token.role,
          .token_id = token.id,
          .session_id = {},
          .peer = credentials.peer,
          .request_id = credentials.request_id};
}

}  // namespace

absl::StatusOr<std::unique_ptr<Access>> Access::Open(const std::string& path, AccessOptions options) {
  auto store = AccessStore::Open(path);
  if (!store.ok()) return store.status();
  std::unique_ptr<Access> access(new Access(*std::move(store), options));
  std::unique_lock lock(access->mutex_);
  if (absl::Status status = access->Load(lock); !status.ok()) return status;
  lock.unlock();
  access->thread_ = std::thread([self = access.get()] { self->Loop(); });
  return access;
}

Access::Access(std::unique_ptr<AccessStore> store, AccessOptions options)
    : store_(std::move(store)),
      options_(options),
      request_prefix_(absl::StrCat(Secret::New().id, "-")),
      refusals_since_us_(NowUs()) {}

Access::~Access() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

bool Access::needs_token() const {
  const std::lock_guard lock(mutex_);
  return !tokens_.empty();
}

absl::StatusOr<Caller> Access::Authenticate(const Credentials& given, std::string_view method) {
  const std::lock_guard lock(mutex_);
  Credentials credentials = given;
  if (credentials.request_id.empty()) credentials.request_id = absl::StrCat(request_prefix_, ++requests_);
  if (tokens_.empty()) return LocalCaller(credentials.peer, credentials.request_id);
  auto caller = Find(credentials);
  if (caller.ok()) {
    const TokenRecord& token = tokens_.find(caller->token_id)->second;
    std::int64_t& used_us = used_us_.try_emplace(token.id, token.last_used_time_us).first->second;
    used_us = std::max(used_us, NowUs());
    return caller;
  }
  absl::Status refusal = Failed(credentials, caller.status());
  Count(EntryOf({.peer = credentials.peer, .request_id = credentials.request_id}, method, "", refusal));
  return refusal;
}

absl::StatusOr<Caller> Access::Find(const Credentials& credentials) const {
  std::string id;
  std::string session_id;
  if (!credentials.token.empty()) {
    const auto claimed = SecretId(credentials.token);
    const auto token = tokens_.find(claimed.value_or(""));
    // Whether there is such a token takes no longer to find out than that there is none.
    const bool known = token != tokens_.end();
    const bool right = HasDigest(credentials.token, known ? token->second.digest : std::string(64, '0'));
    if (!known || !right) return Unauthenticated("the token is not one of this server's", "TOKEN_INVALID");
    id = token->first;
  } else if (!credentials.session.empty()) {
    auto session = SessionId(credentials.session);
    if (!session.ok()) return session.status();
    session_id = *std::move(session);
    id = sessions_.find(session_id)->second.token_id;
  } else {
    return Unauthenticated("needs a token: \"authorization: Bearer TOKEN\"; `orbituned token create` makes one",
                           "TOKEN_REQUIRED");
  }
  if (absl::Status status = CheckToken(id); !status.ok()) return status;
  Caller caller = CallerOf(tokens_.find(id)->second, credentials);
  caller.session_id = std::move(session_id);
  return caller;
}

absl::Status Access::CheckToken(const std::string& id) const {
  const auto token = tokens_.find(id);
  if (token == tokens_.end()) return Unauthenticated("the token is not one of this server's", "TOKEN_INVALID");
  if (token->second.revoke_time_us != 0) return Unauthenticated("the token was revoked", "TOKEN_REVOKED");
  if (!token->second.ValidAt(NowUs())) return Unauthenticated("the token has expired", "TOKEN_EXPIRED");
  return absl::OkStatus();
}

absl::StatusOr<std::string> Access::SessionId(std::string_view session) const {
  const auto found = sessions_.find(SecretId(session).value_or(""));
  const bool known = found != sessions_.end();
  const bool right = HasDigest(session, known ? found->second.digest : std::string(64, '0'));
  if (!known || !right || !found->second.ValidAt(NowUs())) return SessionEnded();
  return found->first;
}

// What a wrong token is answered with. Who comes without one does not guess, and a browser sends a session that has
// ended many times over.
absl::Status Access::Failed(const Credentials& credentials, absl::Status status) {
  if (credentials.token.empty()) return status;
  const std::int64_t now_us = NowUs();
  if (buckets_.size() >= kMostBuckets) buckets_.clear();
  Bucket& bucket = buckets_.try_emplace(credentials.peer, Bucket{options_.failures_at_once, now_us}).first->second;
  const double elapsed_s = static_cast<double>(std::max<std::int64_t>(now_us - bucket.time_us, 0)) / kUsPerS;
  bucket = {std::min(bucket.left + elapsed_s * options_.failures_per_s, options_.failures_at_once), now_us};
  if (bucket.left >= 1) {
    bucket.left -= 1;
    return status;
  }
  return WithReason(absl::ResourceExhaustedError(absl::StrCat("too many wrong tokens from ", credentials.peer,
                                                              ": at most ", options_.failures_at_once, " at once and ",
                                                              options_.failures_per_s, " a second")),
                    "TOO_MANY_FAILURES");
}

absl::Status Access::StillValid(const Caller& caller) const {
  if (caller.token_id.empty()) return absl::OkStatus();
  const std::lock_guard lock(mutex_);
  if (!caller.session_id.empty()) {
    const auto session = sessions_.find(caller.session_id);
    if (session == sessions_.end() || !session->second.ValidAt(NowUs())) return SessionEnded();
  }
  return CheckToken(caller.token_id);
}

absl::StatusOr<Access::Session> Access::LogIn(const Credentials& credentials) {
  auto caller = Authenticate(
      {.token = credentials.token, .session = {}, .peer = credentials.peer, .request_id = credentials.request_id},
      "log in");
  if (!caller.ok()) return caller.status();
  Session session{.secret = {}, .caller = *std::move(caller), .time = options_.session_time};
  if (session.caller.token_id.empty()) return session;  // nothing to remember
  const Secret secret = Secret::New();
  session.secret = secret.text;
  std::map<std::string, absl::Status> displaced;
  {
    const std::lock_guard lock(mutex_);
    const auto oldest = [](const auto& a, const auto& b) { return a.second.expire_time_us < b.second.expire_time_us; };
    if (sessions_.size() >= kMostSessions) {
      const auto first = std::ranges::min_element(sessions_, oldest);
      displaced.emplace(first->first, SessionEnded());
      sessions_.erase(first);
    }
    const std::int64_t expire_time_us = NowUs() + options_.session_time.count() * kUsPerS;
    sessions_[secret.id] = {secret.digest, session.caller.token_id, expire_time_us};
  }
  Tell(displaced);
  Audit(session.caller, "log in", "");
  return session;
}

void Access::LogOut(std::string_view session) {
  std::map<std::string, absl::Status> ended;
  {
    const std::lock_guard lock(mutex_);
    const auto id = SessionId(session);
    if (!id.ok()) return;
    sessions_.erase(*id);
    ended.emplace(*id, SessionEnded());
  }
  Tell(ended);
}

void Access::OnCredentialEnd(CredentialEnd ended) {
  const std::lock_guard lock(ended_mutex_);
  ended_ = std::move(ended);
}

void Access::Tell(const std::map<std::string, absl::Status>& ended) {
  const std::lock_guard lock(ended_mutex_);
  for (const auto& [id, why] : ended) {
    if (ended_) ended_(id, why);
  }
}

absl::Status Access::AuditReady() const {
  const std::lock_guard lock(mutex_);
  if (audit_status_.ok()) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("nothing is changed while the audit log cannot be written: ", audit_status_.message()));
}

void Access::Audit(const Caller& caller, std::string_view method, std::string_view resource) {
  std::unique_lock lock(mutex_);
  queue_.push_back(EntryOf(caller, method, resource, absl::OkStatus()));
  const std::uint64_t mine = ++queued_entries_;
  wake_.notify_all();
  written_.wait(lock, [&] { return tried_entries_ >= mine; });
}

void Access::AuditRefusal(const Caller& caller, std::string_view method, std::string_view resource,
                          const absl::Status& refusal) {
  const std::lock_guard lock(mutex_);
  Count(EntryOf(caller, method, resource, refusal));
}

void Access::Count(AuditEntry entry) {
  RefusalKey key{entry.caller, entry.token_id, entry.peer, entry.method, entry.outcome};
  if (!refusals_.contains(key) && refusals_.size() >= kMostRefusalKinds) {
    entry.caller = entry.role = entry.token_id = entry.resource = entry.request_id = "";
    entry.peer = entry.method = entry.outcome = "various";
    key = {"", "", "various", "various", "various"};
  }
  Refusals& alike = refusals_.try_emplace(std::move(key)).first->second;
  if (alike.unwritten++ == 0) alike.first = std::move(entry);
}

// Each kind once as soon as it is there, and at the end of the window what came of it since.
void Access::QueueRefusals(bool all) {
  if (!audit_status_.ok()) return;  // they are counted on
  const std::int64_t now_us = NowUs();
  const bool over = all || now_us - refusals_since_us_ >= options_.refusals_time.count() * kUsPerS;
  for (auto& [key, alike] : refusals_) {
    if (alike.unwritten == 0 || (alike.written && !over)) continue;
    alike.first.count = std::exchange(alike.unwritten, 0);
    queue_.push_back(alike.first);
    ++queued_entries_;
    alike.written = true;
  }
  if (!over) return;
  refusals_.clear();
  refusals_since_us_ = now_us;
}

void Access::Loop() {
  std::unique_lock lock(mutex_);
  auto next = std::chrono::steady_clock::now();
  while (true) {
    wake_.wait_until(lock, next, [this] { return ending_ || tried_entries_ < queued_entries_; });
    const bool ending = ending_;
    if (ending || std::chrono::steady_clock::now() >= next) {
      next = std::chrono::steady_clock::now() + options_.period;
      (void)Load(lock);  // on an error what was read before stands; the audit log tells of a disk that fails
      WriteUse(lock);
      QueueRefusals(ending);
      if (!ending) RemoveOldAudit(lock);
    }
    WriteAudit(lock);
    if (ending) return;
  }
}

void Access::WriteAudit(std::unique_lock<std::mutex>& lock) {
  if (queue_.empty()) return;
  const std::vector<AuditEntry> entries(queue_.begin(), queue_.end());
  const std::uint64_t last = queued_entries_;
  lock.unlock();
  const absl::Status status = store_->Append(entries);
  lock.lock();
  audit_status_ = status;
  if (status.ok()) queue_.erase(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(entries.size()));
  tried_entries_ = last;
  written_.notify_all();
}

void Access::WriteUse(std::unique_lock<std::mutex>& lock) {
  std::map<std::string, std::int64_t> due;
  for (const auto& [id, time_us] : used_us_) {
    const auto token = tokens_.find(id);
    if (token != tokens_.end() && time_us >= token->second.last_used_time_us + kUseResolutionUs) due[id] = time_us;
  }
  used_us_.clear();
  if (due.empty()) return;
  lock.unlock();
  const bool noted = store_->NoteUse(due).ok();
  lock.lock();
  for (const auto& [id, time_us] : due) {
    if (noted && tokens_.contains(id)) tokens_[id].last_used_time_us = time_us;
  }
}

void Access::RemoveOldAudit(std::unique_lock<std::mutex>& lock) {
  if (options_.retain_audit_days == 0 || std::chrono::steady_clock::now() < next_removal_) return;
  lock.unlock();
  const std::int64_t now_us = NowUs();
  const auto kept_us = static_cast<std::int64_t>(options_.retain_audit_days * 86'400e6);
  const auto removed = store_->RemoveOldestAudit(now_us - kept_us, kMostRemoved, now_us);
  if (removed.ok() && *removed > 0) Log(LogLevel::kInfo, "audit log: removed what is old", {{"entries", *removed}});
  lock.lock();
  const bool all = removed.ok() && *removed < kMostRemoved;  // else again soon
  if (all) next_removal_ = std::chrono::steady_clock::now() + kBetweenRemovals;
}

// Reads the tokens where another process has changed them, and tells of what is valid no more.
absl::Status Access::Load(std::unique_lock<std::mutex>& lock) {
  const std::int64_t known_changes = foreign_changes_;
  lock.unlock();
  const auto changes = store_->ForeignChanges();
  const bool changed = changes.ok() && *changes != known_changes;
  auto tokens = changed ? store_->ListTokens() : absl::StatusOr<std::vector<TokenRecord>>();
  lock.lock();
  if (!changes.ok()) return changes.status();
  if (changed && !tokens.ok()) return tokens.status();
  if (changed) {
    foreign_changes_ = *changes;
    tokens_.clear();
    for (TokenRecord& token : *tokens) tokens_.emplace(token.id, std::move(token));
  }
  const std::map<std::string, absl::Status> ended = NewlyEnded();
  if (ended.empty()) return absl::OkStatus();
  lock.unlock();
  Tell(ended);
  lock.lock();
  return absl::OkStatus();
}

std::map<std::string, absl::Status> Access::NewlyEnded() {
  std::map<std::string, absl::Status> ended;
  std::set<std::string> valid;
  for (const auto& [id, token] : tokens_) {
    if (CheckToken(id).ok()) valid.insert(id);
  }
  for (const std::string& id : valid_) {
    if (!valid.contains(id)) ended.emplace(id, CheckToken(id));
  }
  valid_ = std::move(valid);
  std::erase_if(sessions_, [&](const auto& session) {
    absl::Status status = session.second.ValidAt(NowUs()) ? CheckToken(session.second.token_id) : SessionEnded();
    if (!status.ok()) ended.emplace(session.first, std::move(status));
    return ended.contains(session.first);
  });
  return ended;
}

}  // namespace orbitune
