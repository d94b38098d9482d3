// A gRPC service whose methods are the API's: each handler is one line, Call or Stream with its own name.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/api/api.h"
#include "server/api/error.h"
#include "server/rpc/credentials.h"

namespace orbitune {

inline grpc::Status ToGrpc(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const google::rpc::Status details = ToRpcStatus(status);
  return {static_cast<grpc::StatusCode>(status.code()), details.message(), details.SerializeAsString()};
}

// Calls that have begun and whose answer has not yet gone out. Thread-safe.
class CallsInFlight {
 public:
  void Begin() {
    const std::lock_guard lock(mutex_);
    ++calls_;
  }
  void End() {
    const std::lock_guard lock(mutex_);
    if (--calls_ == 0) none_.notify_all();
  }
  // False at the deadline.
  bool AwaitNone(std::chrono::milliseconds most) {
    std::unique_lock lock(mutex_);
    return none_.wait_for(lock, most, [this] { return calls_ == 0; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable none_;
  int calls_ = 0;  // guarded by mutex_
};

class UnaryReactor final : public grpc::ServerUnaryReactor {
 public:
  explicit UnaryReactor(CallsInFlight& calls) : calls_(calls) { calls_.Begin(); }
  void OnDone() override {
    calls_.End();
    delete this;
  }

 private:
  CallsInFlight& calls_;
};

// A server stream fed from the API. Lives until the call is done. The feed gives its end once, in answer to Next, which
// is asked when no write is in flight: one StartWrite at a time, one Finish, and no lock.
template <typename Response>
class StreamReactor final : public grpc::ServerWriteReactor<Response> {
 public:
  StreamReactor(std::shared_ptr<Feed> feed, CallsInFlight& calls) : feed_(std::move(feed)), calls_(calls) {
    calls_.Begin();
    Next();
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      feed_->End(absl::CancelledError("the watcher is gone"));
      sent_ = items_.size();
    }
    Next();
  }
  void OnCancel() override { feed_->End(absl::CancelledError("cancelled by the watcher")); }
  void OnDone() override {
    calls_.End();
    delete this;
  }

 private:
  // What is taken from the feed at a time.
  static constexpr std::size_t kBatch = 16;

  void Next() {
    if (sent_ < items_.size()) return Write();
    feed_->Next(kBatch, [this](Feed::Batch batch) {
      if (batch.end) return this->Finish(ToGrpc(*batch.end));
      items_.clear();
      for (const StreamPart& part : batch.parts) {
        items_.insert(items_.end(), &part.front(), &part.front() + part.size());
      }
      sent_ = 0;
      Write();
    });
  }

  void Write() {
    // Without a buffer hint: gRPC 1.51 may keep what was hinted until the connection's next sign of life, half a
    // minute.
    this->StartWrite(static_cast<const Response*>(items_[sent_++]->message.get()));
  }

  const std::shared_ptr<Feed> feed_;
  CallsInFlight& calls_;
  std::vector<FeedItem> items_;
  std::size_t sent_ = 0;
};

// Service: the generated one, v1::TuningService.
template <typename Service>
class ApiService : public Service::CallbackService {
 protected:
  using Context = grpc::CallbackServerContext;
  using Reactor = grpc::ServerUnaryReactor;

  // Both outlive this.
  ApiService(Api& api, CallsInFlight& calls) : api_(api), calls_(calls) {}

  template <typename Request, typename Response>
  Reactor* Call(const char* method, Context* context, const Request* request, Response* response) {
    Reactor* reactor = new UnaryReactor(calls_);
    const Method& called = Find<Request>(method);
    auto caller = api_.Authenticate(CredentialsOf(*context), called.descriptor->full_name());
    if (!caller.ok()) {
      reactor->Finish(ToGrpc(caller.status()));
      return reactor;
    }
    context->AddInitialMetadata(kRequestId, caller->request_id);
    api_.Call(called, {*std::move(caller), [context] { return context->IsCancelled(); }}, *request, response,
              [reactor](const absl::Status& status) { reactor->Finish(ToGrpc(status)); });
    return reactor;
  }

  template <typename Response, typename Request>
  grpc::ServerWriteReactor<Response>* Stream(const char* method, Context* context, const Request* request) {
    const Method& called = Find<Request>(method);
    auto caller = api_.Authenticate(CredentialsOf(*context), called.descriptor->full_name());
    if (caller.ok()) context->AddInitialMetadata(kRequestId, caller->request_id);
    return new StreamReactor<Response>(
        caller.ok() ? api_.Open(called, {*std::move(caller)}, *request) : EndedFeed(caller.status()), calls_);
  }

 private:
  static constexpr char kRequestId[] = "x-request-id";

  template <typename Request>
  const Method& Find(const char* name) const {
    const Method* method = api_.methods().Find(absl::StrCat(Service::service_full_name(), ".", name));
    ORBITUNE_CHECK(method != nullptr && method->request->GetDescriptor() == Request::descriptor());
    return *method;
  }

  Api& api_;
  CallsInFlight& calls_;
};

}  // namespace orbitune
