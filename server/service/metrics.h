// What the server does, for Prometheus.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "service/sandbox/reader_host.h"
#include "service/scheduling/scheduler.h"
#include "service/tenants.h"

namespace fogbank::service {

/// http://ADDRESS/metrics in Prometheus' text format; all figures are taken when they are asked for. Tenants
/// are a label; tokens, names of scenes and of jobs are nowhere.
class MetricsEndpoint {
 public:
  /// `address` is HOST:PORT. Throws OptionError when nothing can listen there.
  MetricsEndpoint(const std::string& address, const Tenants& tenants, const Scheduler& scheduler,
                  const ReaderHost& readers, std::filesystem::path data);
  ~MetricsEndpoint();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace fogbank::service
