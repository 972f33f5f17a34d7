#include "service/probe_service.h"

#include "render/picture_plan.h"
#include "service/answers.h"
#include "service/job_settings.h"
#include "service/names.h"
#include "service/probe_settings.h"
#include "transport/plan.h"

namespace fogbank::service {

ProbeReactor* ProbeServiceImplementation::Probe(grpc::CallbackServerContext* context) {
  return start_probe(*context, services_);
}

grpc::ServerUnaryReactor* ProbeServiceImplementation::GetPlan(grpc::CallbackServerContext* context,
                                                              const v1::GetPlanRequest* request,
                                                              v1::GetPlanResponse* response) {
  return answer_later(
      context, services_.control, [this, request, response](grpc::ServerUnaryReactor* reactor) {
        services_.scenes.acquire(
            parse_scene_name(request->scene()),
            [this, request, response, reactor](std::shared_ptr<const transport::World> world, double,
                                               std::exception_ptr error) {
              if (error) {
                reactor->Finish(status_of(error));
                return;
              }
              // Not in the loader's thread, for which scenes may wait.
              const bool posted = services_.control.post([world = std::move(world), request, response,
                                                          reactor] {
                grpc::Status status;
                try {
                  const transport::Plan plan(*world, resolve_plan(*request, world->scene()));
                  const auto add = [response](const std::string& term, bool on, const std::string& reason) {
                    v1::PlanTerm& message = *response->add_terms();
                    message.set_term(term);
                    message.set_on(on);
                    message.set_reason(reason);
                  };
                  for (const transport::PlanTerm& term : plan.terms()) add(term.term, term.on, term.reason);
                  const JobSettings picture = resolve_settings({}, world->scene(), 1);
                  for (const integrators::Decision& one : render::picture_plan(*world, picture.engine))
                    add(one.what, one.on, one.reason);
                } catch (...) {
                  status = status_of(std::current_exception());
                }
                reactor->Finish(status);
              });
              if (!posted) reactor->Finish(shutting_down_status());
            });
      });
}

void ProbeServiceImplementation::shut_down() {
  services_.shutting_down = true;
  services_.pump.news();
}

}  // namespace fogbank::service
