#include "service/access.h"

#include <map>

namespace fogbank::service {

std::optional<Scope> scope_of(std::string_view name) {
  if (name == "render") return Scope::render;
  if (name == "upload") return Scope::upload;
  if (name == "admin") return Scope::admin;
  return std::nullopt;
}

std::string_view name_of(Scope scope) {
  switch (scope) {
    case Scope::render:
      return "render";
    case Scope::upload:
      return "upload";
    case Scope::admin:
      break;
  }
  return "admin";
}

const Access* access_of(std::string_view rpc) {
  static const Access anybody{};
  static const Access reads{.scopes = {Scope::render, Scope::upload}};
  static const Access renders{.scopes = {Scope::render}};
  static const Access makes_jobs{.scopes = {Scope::render}, .changes = true};
  static const Access uploads{.scopes = {Scope::upload}};
  static const Access makes_scenes{.scopes = {Scope::upload}, .changes = true};
  static const Access administers{.scopes = {Scope::admin}, .changes = true};
  static const std::map<std::string_view, const Access*> table = {
      {"ServerService.GetCapabilities", &anybody},
      {"ServerService.GetServerStatus", &anybody},
      {"SceneService.PrepareScene", &uploads},
      {"SceneService.QueryBlob", &uploads},
      {"SceneService.UploadBlob", &makes_scenes},
      {"SceneService.CreateScene", &makes_scenes},
      {"SceneService.GetScene", &reads},
      {"SceneService.ListScenes", &reads},
      {"SceneService.DeleteScene", &makes_scenes},
      {"RenderService.CreateJob", &makes_jobs},
      {"RenderService.GetJob", &renders},
      {"RenderService.ListJobs", &renders},
      {"RenderService.CancelJob", &makes_jobs},
      {"RenderService.PauseJob", &makes_jobs},
      {"RenderService.ResumeJob", &makes_jobs},
      {"RenderService.WatchJob", &renders},
      {"RenderService.DownloadImage", &renders},
      {"FarmService.LeaseTasks", &renders},
      {"FarmService.CompleteTasks", &renders},
      {"FarmService.ReadJobLog", &renders},
      {"FarmService.OpenReplica", &makes_jobs},
      {"FarmService.AdvanceReplica", &renders},
      {"FarmService.PerformTasks", &renders},
      {"FarmService.CloseReplica", &renders},
      {"ProbeService.Probe", &renders},
      {"ProbeService.GetPlan", &renders},
      {"FlatlandService.ProbeFlatland", &renders},
      {"FlatlandService.FillFlatlandCache", &renders},
      {"CacheService.GetCache", &reads},
      {"CacheService.ListCaches", &reads},
      {"CacheService.VerifyCache", &reads},
      {"CacheService.ViewCache", &renders},
      {"CacheService.FillCache", &makes_jobs},
      {"CacheService.ExportCache", &reads},
      {"CacheService.MergeCaches", &uploads},
      {"CacheService.ImportCache", &makes_scenes},
      {"CacheService.DeleteCache", &makes_scenes},
      {"CacheService.CollectCacheGarbage", &administers},
  };
  const auto found = table.find(rpc);
  return found == table.end() ? nullptr : found->second;
}

}  // namespace fogbank::service
