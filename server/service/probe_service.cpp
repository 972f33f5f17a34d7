#include "service/probe_service.h"

#include "render/picture_plan.h"
#include "service/answers.h"
#include "service/job_settings.h"
#include "service/names.h"
#include "service/probe_settings.h"
#include "transport/plan.h"

namespace fogbank::service {

ProbeReactor* ProbeServiceImplementation::Probe(grpc::CallbackServerContext* context) {
  return start_in_tenant<ProbeReactor>(tenants_, *context, "ProbeService.Probe",
                                       [&](Tenant& tenant) { return start_probe(*context, tenant.probes); });
}

namespace {

/// What the scene's probes and a picture with its own settings need.
void list_terms(const v1::GetPlanRequest& request, const transport::World& world,
                v1::GetPlanResponse& response) {
  const auto add = [&response](const std::string& term, bool on, const std::string& reason) {
    v1::PlanTerm& message = *response.add_terms();
    message.set_term(term);
    message.set_on(on);
    message.set_reason(reason);
  };
  const transport::Plan plan(world, resolve_plan(request, world.scene()));
  for (const transport::PlanTerm& term : plan.terms()) add(term.term, term.on, term.reason);
  const JobSettings picture = resolve_settings({}, world.scene(), 1);
  for (const integrators::Decision& one : render::picture_plan(world, picture.engine))
    add(one.what, one.on, one.reason);
}

}  // namespace

grpc::ServerUnaryReactor* ProbeServiceImplementation::GetPlan(grpc::CallbackServerContext* context,
                                                              const v1::GetPlanRequest* request,
                                                              v1::GetPlanResponse* response) {
  return answer_later(
      context, control_, [this, context, request, response](grpc::ServerUnaryReactor* reactor) {
        tenants_.enter(*context, "ProbeService.GetPlan")
            .scenes.acquire(parse_scene_name(request->scene()),
                            [this, request, response, reactor](std::shared_ptr<const transport::World> world,
                                                               double, std::exception_ptr error) {
                              if (error) {
                                reactor->Finish(status_of(error));
                                return;
                              }
                              // Not in the loader's thread, for which scenes may wait.
                              const bool posted =
                                  control_.post([world = std::move(world), request, response, reactor] {
                                    grpc::Status status;
                                    try {
                                      list_terms(*request, *world, *response);
                                    } catch (...) {
                                      status = status_of(std::current_exception());
                                    }
                                    reactor->Finish(status);
                                  });
                              if (!posted) reactor->Finish(shutting_down_status());
                            });
      });
}

}  // namespace fogbank::service
