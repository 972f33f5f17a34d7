#include "request_server.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <utility>

#include "core/sha256.h"
#include "fogbank/v1/farm.grpc.pb.h"
#include "fogbank/v1/render.grpc.pb.h"
#include "fogbank/v1/scene.grpc.pb.h"
#include "fuzz.h"
#include "service/build_id.h"
#include "service/sandbox/reader.h"

namespace fogbank::fuzz {

namespace fs = std::filesystem;

namespace {

/// All that requests can ask for of a scene, in little time.
constexpr const char* scene_file = R"(<scene version="3.0.0">
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="thinlens"><float name="fov" value="50"/><float name="aperture_radius" value="0.01"/>
    <float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
    <ref id="fog"/></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.3"/><float name="albedo" value="0.8"/>
    <phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale value="6"/></transform><bsdf type="null"/>
    <ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2"/></transform>
    <emitter type="area"><float name="radiance" value="8"/></emitter></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/></transform><bsdf type="diffuse"/></shape>
</scene>
)";

constexpr std::chrono::seconds patience{120};  // against hanging
constexpr std::chrono::seconds patience_of_inputs{1};

void set_deadline(grpc::ClientContext& context, std::chrono::seconds after) {
  context.set_deadline(std::chrono::system_clock::now() + after);
}

/// What the server must be able to do whatever it was asked before.
void require_ok(const grpc::Status& status, const char* what) {
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.error_message().c_str());
  require(status.ok(), what);
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  require(from.size() == to.size(), "a placeholder is as long as what it stands for");
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

std::string after_slash(const std::string& name) { return name.substr(name.find('/') + 1); }

grpc::ByteBuffer to_buffer(const google::protobuf::Message& message) {
  const grpc::Slice slice(message.SerializeAsString());
  return {&slice, 1};
}

v1::RenderSettings small_picture(const char* integrator) {
  v1::RenderSettings settings;
  settings.set_integrator(integrator);
  settings.set_width(8);
  settings.set_height(8);
  settings.set_samples_per_pixel(1);
  return settings;
}

}  // namespace

RequestServer::RequestServer() : readers_(service::read_scene_files) {
  spdlog::set_level(spdlog::level::off);
  std::string pattern = (fs::temp_directory_path() / "fogbank-requests-XXXXXX").string();
  folder_ = ::mkdtemp(pattern.data());
  service::ServerOptions options;
  options.listen = "unix:" + (folder_ / "socket").string();
  options.data = folder_ / "data";
  options.threads = 1;
  options.memory_bytes = int64_t{256} << 20;
  server_ = std::make_unique<service::Server>(options, readers_);
  channel_ = grpc::CreateChannel(server_->target(), grpc::InsecureChannelCredentials());
  blob_ = sha256(scene_file);
  restore();
}

RequestServer::~RequestServer() {
  channel_.reset();
  server_.reset();
  fs::remove_all(folder_);
}

void RequestServer::upload_scene() {
  const auto scenes = v1::SceneService::NewStub(channel_);
  v1::CreateSceneRequest request;
  {
    grpc::ClientContext context;
    set_deadline(context, patience);
    v1::UploadBlobResponse response;
    const auto stream = scenes->UploadBlob(&context, &response);
    v1::UploadBlobRequest part;
    part.mutable_header()->set_sha256(blob_);
    part.mutable_header()->set_size(static_cast<int64_t>(std::string(scene_file).size()));
    stream->Write(part);
    part.set_chunk(scene_file);
    stream->Write(part);  // fails where the server has the file
    stream->WritesDone();
    require_ok(stream->Finish(), "a file can be uploaded");
  }
  v1::ManifestEntry& entry = *request.mutable_manifest()->add_entries();
  entry.set_path("scene.xml");
  entry.set_sha256(blob_);
  entry.set_size(static_cast<int64_t>(std::string(scene_file).size()));
  request.mutable_manifest()->set_main_path("scene.xml");
  request.set_request_id("scene-" + std::to_string(++requests_));
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::CreateSceneResponse response;
  require_ok(scenes->CreateScene(&context, request, &response), "a scene can be loaded");
  scene_ = response.scene().name();
  cache_ = response.scene().cache();
}

v1::Job RequestServer::create_job(const v1::RenderSettings& settings, bool leased) {
  v1::CreateJobRequest request;
  request.set_request_id("job-" + std::to_string(++requests_));
  request.set_scene(scene_);
  *request.mutable_settings() = settings;
  request.set_leased(leased);
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::CreateJobResponse response;
  require_ok(v1::RenderService::NewStub(channel_)->CreateJob(&context, request, &response),
             "a job can be created");
  return response.job();
}

void RequestServer::wait_for(const std::string& job) {
  v1::WatchJobRequest request;
  request.set_name(job);
  grpc::ClientContext context;
  set_deadline(context, patience);
  const auto stream = v1::RenderService::NewStub(channel_)->WatchJob(&context, request);
  v1::WatchJobResponse event;
  while (stream->Read(&event)) {
  }
  require_ok(stream->Finish(), "a job can be watched");
  require(event.ended().job().state() == v1::JOB_STATE_SUCCEEDED, "a job succeeds");
}

bool RequestServer::exists(const std::string& job) {
  v1::GetJobRequest request;
  request.set_name(job);
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::GetJobResponse response;
  return v1::RenderService::NewStub(channel_)->GetJob(&context, request, &response).ok() &&
         response.job().state() != v1::JOB_STATE_CANCELLED &&
         response.job().state() != v1::JOB_STATE_FAILED && response.job().state() != v1::JOB_STATE_PAUSED &&
         (job == ended_job_ || response.job().state() != v1::JOB_STATE_SUCCEEDED);
}

void RequestServer::open_replica() {
  v1::OpenReplicaRequest request;
  request.set_scene(scene_);
  *request.mutable_settings() = leased_job_.settings();
  request.set_log(after_slash(leased_job_.name()) + "-0");
  request.set_build_id(service::build_id());
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::OpenReplicaResponse response;
  require_ok(v1::FarmService::NewStub(channel_)->OpenReplica(&context, request, &response),
             "a replica can be opened");
  replica_ = response.replica();
}

/// Jobs that inputs have created, so that they take neither time nor room from those that follow.
void RequestServer::cancel_others() {
  const auto jobs = v1::RenderService::NewStub(channel_);
  v1::ListJobsRequest list;
  list.set_page_size(20);
  v1::ListJobsResponse listed;
  {
    grpc::ClientContext context;
    set_deadline(context, patience);
    require_ok(jobs->ListJobs(&context, list, &listed), "jobs can be listed");
  }
  for (const v1::Job& job : listed.jobs()) {
    if (job.name() == leased_job_.name() ||
        (job.state() != v1::JOB_STATE_QUEUED && job.state() != v1::JOB_STATE_RUNNING &&
         job.state() != v1::JOB_STATE_PAUSED))
      continue;
    v1::CancelJobRequest request;
    request.set_name(job.name());
    grpc::ClientContext context;
    set_deadline(context, patience);
    v1::CancelJobResponse response;
    jobs->CancelJob(&context, request, &response);  // it may have ended by now
  }
}

void RequestServer::restore() {
  {
    v1::GetSceneRequest request;
    request.set_name(scene_);
    grpc::ClientContext context;
    set_deadline(context, patience);
    v1::GetSceneResponse response;
    if (!v1::SceneService::NewStub(channel_)->GetScene(&context, request, &response).ok()) upload_scene();
  }
  cancel_others();
  if (!exists(ended_job_)) {
    ended_job_ = create_job(small_picture("volpath"), false).name();
    wait_for(ended_job_);
  }
  if (!exists(leased_job_.name())) {
    leased_job_ = create_job(small_picture("radiance-cache"), true);
    replica_.clear();
  }
  v1::AdvanceReplicaRequest request;
  request.set_replica(replica_);
  grpc::ClientContext context;
  set_deadline(context, patience);
  v1::AdvanceReplicaResponse response;
  if (!v1::FarmService::NewStub(channel_)->AdvanceReplica(&context, request, &response).ok()) open_replica();
}

std::string RequestServer::with_names(std::string input) {
  restore();
  std::array<char, 17> id{};
  std::snprintf(id.data(), id.size(), "input-%010llu", static_cast<unsigned long long>(++requests_));
  for (const auto& [from, to] : std::initializer_list<std::pair<const std::string&, std::string>>{
           {placeholder::scene, after_slash(scene_)},
           {placeholder::cache, after_slash(cache_)},
           {placeholder::blob, blob_},
           {placeholder::ended_job, after_slash(ended_job_)},
           {placeholder::leased_job, after_slash(leased_job_.name())},
           {placeholder::replica, after_slash(replica_)},
           {placeholder::build, service::build_id()},
           {placeholder::request_id, id.data()}}) {
    replace(input, from, to);
  }
  return input;
}

grpc::Status RequestServer::call(Call& call) {
  for (const auto& request : call.requests) {
    // What a damaged coordinator sends has the right hash.
    if (auto* const entries = dynamic_cast<v1::AdvanceReplicaRequest*>(request.get())) {
      for (v1::JobLogEntry& entry : *entries->mutable_entries())
        if (entry.sha256() == placeholder::entry_hash) entry.set_sha256(sha256(entry.data()));
    }
  }
  grpc::ClientContext context;
  set_deadline(context, patience_of_inputs);
  grpc::CompletionQueue queue;
  grpc::GenericStub stub(channel_);
  const std::string path = "/" + call.method->service()->full_name() + "/" + call.method->name();
  const auto stream = stub.PrepareCall(&context, path, &queue);
  const auto succeeded = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    require(queue.Next(&tag, &ok), "an operation of a call ends");
    return ok;
  };
  stream->StartCall(nullptr);
  bool going_on = succeeded();
  for (size_t i = 0; going_on && i < call.requests.size(); ++i) {
    stream->Write(to_buffer(*call.requests[i]), nullptr);
    going_on = succeeded();
  }
  if (going_on) {
    stream->WritesDone(nullptr);
    succeeded();
  }
  grpc::ByteBuffer answer;
  stream->Read(&answer, nullptr);
  if (succeeded() && call.method->server_streaming()) context.TryCancel();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  succeeded();
  return status;
}

}  // namespace fogbank::fuzz
