#include "service/tenants.h"

#include <algorithm>
#include <utility>

#include "core/files.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

/// Shares of the memory for scenes and caches.
constexpr int64_t scene_parts = 2;
constexpr int64_t cache_parts = 1;

std::string_view view(const grpc::string_ref& text) { return {text.data(), text.size()}; }

}  // namespace

Tenants::Tenants(Settings settings, TaskQueue& control, TaskQueue& writer, TaskQueue& loader,
                 ReaderHost& readers, Scheduler& scheduler, FilmBudget& films, TraceLog* traces)
    : settings_(std::move(settings)),
      quotas_(settings_.data / "quotas.json"),
      shared_{.control = control,
              .writer = writer,
              .loader = loader,
              .readers = readers,
              .scheduler = scheduler,
              .films = films,
              .quotas = quotas_,
              .traces = traces,
              .films_freed =
                  [this] {
                    for (Tenant* const tenant : all()) tenant->jobs.admit();
                  }},
      tokens_(settings_.data / "tokens.json"),
      audit_(settings_.authentication ? std::make_unique<AuditLog>(settings_.data / "audit.log") : nullptr) {}

void Tenants::open_known() {
  if (!settings_.authentication) {
    open("");
    return;
  }
  const fs::path folder = settings_.data / "tenants";
  fs::create_directories(folder);
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_directory() && is_tenant_name(name)) names.push_back(name);
  }
  std::ranges::sort(names);
  for (const std::string& name : names) open(name);
}

Tenant& Tenants::open(const std::string& name) {
  const auto known = [&] {
    const std::lock_guard lock(mutex_);
    const auto found = tenants_.find(name);
    return found == tenants_.end() ? nullptr : found->second.get();
  };
  if (Tenant* const tenant = known()) return *tenant;
  // Reading a folder takes its time; those who are there already don't wait for it.
  const std::lock_guard one_at_a_time(opening_);
  if (Tenant* const tenant = known()) return *tenant;
  const int number = static_cast<int>(all().size());
  const fs::path folder = name.empty() ? settings_.data : settings_.data / "tenants" / name;
  create_folder_durably(folder);
  auto tenant = std::make_unique<Tenant>(name, number, folder, settings_.tenant, shared_);
  Tenant& opened = *tenant;
  {
    const std::lock_guard lock(mutex_);
    tenants_.emplace(name, std::move(tenant));
    const auto share =
        settings_.memory_bytes / (scene_parts + cache_parts) / static_cast<int64_t>(tenants_.size());
    for (const auto& [other_name, other] : tenants_) {
      other->scenes.set_memory_budget(scene_parts * share);
      other->caches.set_memory_budget(cache_parts * share);
    }
  }
  opened.jobs.resume();
  return opened;
}

std::vector<Tenant*> Tenants::all() const {
  std::vector<Tenant*> all;
  const std::lock_guard lock(mutex_);
  all.reserve(tenants_.size());
  for (const auto& [name, tenant] : tenants_) all.push_back(tenant.get());
  return all;
}

Identity Tenants::identify(const grpc::CallbackServerContext& context) {
  constexpr std::string_view bearer = "Bearer ";
  const auto header = context.client_metadata().find("authorization");
  if (header != context.client_metadata().end()) {
    const std::string_view value = view(header->second);
    return tokens_.identify(value.starts_with(bearer) ? value.substr(bearer.size()) : "");
  }
  // A certificate that the client's authority has signed: of a worker.
  const auto names = context.auth_context()->FindPropertyValues("x509_common_name");
  if (!names.empty() && is_tenant_name(view(names.front()))) {
    return {.tenant = std::string(view(names.front())),
            .scopes = {Scope::render, Scope::upload},
            .by = "certificate"};
  }
  throw RpcError(StatusCode::UNAUTHENTICATED, "TOKEN_MISSING",
                 "this server wants to know who calls: send a token (fogbank token create)");
}

Tenant& Tenants::enter(const grpc::CallbackServerContext& context, std::string_view rpc) {
  if (!settings_.authentication) return open("");
  const Access* const access = access_of(rpc);
  std::optional<Identity> identity;
  try {
    identity = identify(context);
    const auto& scopes = identity->scopes;
    const bool allowed =
        access != nullptr &&
        (access->scopes.empty() || scopes.contains(Scope::admin) ||
         std::ranges::any_of(access->scopes, [&](Scope scope) { return scopes.contains(scope); }));
    if (!allowed) {
      const Scope needed =
          access == nullptr || access->scopes.empty() ? Scope::admin : *access->scopes.begin();
      throw RpcError(StatusCode::PERMISSION_DENIED, "SCOPE_MISSING",
                     "the token lacks the scope " + std::string(name_of(needed)),
                     {{"scope", std::string(name_of(needed))}});
    }
  } catch (const RpcError& error) {
    audit_->record(rpc, error.reason(), context.peer(), identity ? &*identity : nullptr);
    throw;
  }
  if (access->changes) audit_->record(rpc, "allowed", context.peer(), &*identity);
  return open(identity->tenant);
}

}  // namespace fogbank::service
