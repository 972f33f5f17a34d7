#include "service/quota_file.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "service/token_file.h"

namespace fogbank::service {

namespace {

constexpr std::string_view everybody_else = "*";

template <typename Number>
void read(const nlohmann::json& entry, const char* name, std::optional<Number>& value) {
  const auto found = entry.find(name);
  if (found == entry.end() || found->is_null()) return;
  value = found->get<Number>();
  if (!std::isfinite(static_cast<double>(*value)) || *value < 0)
    throw std::runtime_error(std::string(name) + " must not be negative");
}

}  // namespace

QuotaFile::QuotaFile(std::filesystem::path path) : file_(std::move(path), &QuotaFile::parse) {}

QuotaFile::Quotas QuotaFile::parse(const std::string& text) {
  const nlohmann::json file = nlohmann::json::parse(text);
  if (file.at("version").get<int>() != 1) throw std::runtime_error("it is of another version");
  Quotas quotas;
  for (const auto& [tenant, entry] : file.at("quotas").items()) {
    if (tenant != everybody_else && !is_tenant_name(tenant))
      throw std::runtime_error("a tenant's name is not one");
    Quota quota;
    read(entry, "jobs", quota.jobs);
    read(entry, "stored_bytes", quota.stored_bytes);
    read(entry, "cache_bytes", quota.cache_bytes);
    read(entry, "watchers", quota.watchers);
    read(entry, "cpu_seconds", quota.cpu_seconds);
    std::optional<double> window;
    read(entry, "window_seconds", window);
    quota.window_seconds = window.value_or(quota.window_seconds);
    if (quota.window_seconds <= 0) throw std::runtime_error("window_seconds must be positive");
    quotas.emplace(tenant, quota);
  }
  return quotas;
}

Quota QuotaFile::of(std::string_view tenant) {
  const std::lock_guard lock(mutex_);
  const Quotas& quotas = file_.get();
  auto found = quotas.find(tenant);
  if (found == quotas.end()) found = quotas.find(everybody_else);
  return found == quotas.end() ? Quota{} : found->second;
}

}  // namespace fogbank::service
