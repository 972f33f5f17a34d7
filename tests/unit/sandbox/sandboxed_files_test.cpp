// Scenes loaded through a reading process, and processes that misbehave.
#include "service/sandbox/sandboxed_files.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "scene/image_files.h"
#include "scene/loader.h"
#include "scene/scene_file_reader.h"
#include "scene/scene_files.h"
#include "scene/texture_library.h"
#include "service/sandbox/encoding.h"
#include "service/sandbox/reader.h"

namespace fogbank::service {
namespace {

using scene::test::TemporaryFolder;
using scene::test::Thrown;
using scene::test::thrown_by;

/// What a shape's file does to a reading process that answers everything else as it should.
template <typename Misdeed>
ReaderHost::Work misbehaving(const Misdeed& misdeed) {
  return [misdeed](const Socket&) {
    misdeed();
    ::_exit(0);
  };
}

Thrown thrown_when_parsing(const ReaderHost::Work& work) {
  ReaderHost host(work);
  TemporaryFolder folder;
  folder.write("scene.xml", "<scene version='3.0.0'/>");
  return thrown_by([&] {
    SandboxedFiles files(host, scene::folder_source(folder.path().string()));
    files.parse("scene.xml", {});
  });
}

TEST(SandboxedFiles, LoadWhatIsLoadedInProcess) {
  ReaderHost host(read_scene_files);
  for (const auto& entry : std::filesystem::recursive_directory_iterator("scenes")) {
    if (entry.path().extension() != ".xml") continue;
    SCOPED_TRACE(entry.path());
    const auto folder = scene::folder_source(entry.path().parent_path().string());
    const std::string name = entry.path().filename().string();
    std::string expected;
    try {
      expected = scene::load_scene(name, folder, {})->fingerprint;
    } catch (const Error& error) {  // a part of a scene, or one whose files are not here
      expected = error.what();
    }
    const auto files = std::make_shared<SandboxedFiles>(host, folder);
    EXPECT_EQ(files->references(name, {}), scene::list_references(name, folder, {}));
    std::string found;
    try {
      found = scene::load_scene(name, files, {})->fingerprint;
    } catch (const Error& error) {
      found = error.what();
    }
    EXPECT_EQ(found, expected);
  }
}

TEST(SandboxedFiles, MeshesAndImagesAreThoseOfTheReaders) {
  ReaderHost host(read_scene_files);
  TemporaryFolder folder;
  folder.write("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
      .write("damaged.obj", "v 0 0 0\nf 1 2 3\n")
      .write("bytes.png", scene::test::image_file<uint8_t>("png", 4, 3, scene::test::grid))
      .write("floats.exr",
             scene::test::image_file<float>("openexr", 1, 2, {1, 2, 3, 0.5f, 6, -7}, {"R", "G", "B"}));
  const auto stored = scene::folder_source(folder.path().string());
  SandboxedFiles files(host, stored);
  const auto direct = scene::read_in_process(stored);
  const SourceLocation where{"scene.xml", 3, "<shape>"};
  const scene::MeshFileRequest request{.type = "obj",
                                       .shape_index = 0,
                                       .options = {.path = "mesh.obj",
                                                   .face_normals = false,
                                                   .flip_tex_coords = true,
                                                   .max_smooth_angle_degrees = 20}};
  const scene::Mesh mesh = files.mesh(request, where);
  const scene::Mesh expected = direct->mesh(request, where);
  EXPECT_EQ(mesh.positions, expected.positions);
  EXPECT_EQ(mesh.normals, expected.normals);
  EXPECT_EQ(mesh.uvs, expected.uvs);
  EXPECT_EQ(mesh.triangles, expected.triangles);
  EXPECT_GT(mesh.positions.capacity(), mesh.positions.size());
  EXPECT_EQ(files.hash("mesh.obj"), direct->hash("mesh.obj"));

  for (const std::string path : {"bytes.png", "floats.exr"})
    for (const bool raw : {false, true}) {
      const scene::Image image = files.image(path, raw, where);
      const scene::Image same = direct->image(path, raw, where);
      EXPECT_EQ(image.width, same.width);
      EXPECT_EQ(image.height, same.height);
      EXPECT_EQ(image.channels, same.channels);
      EXPECT_EQ(image.data, same.data);
      EXPECT_EQ(image.bytes, same.bytes);
      EXPECT_EQ(image.decode, same.decode);
      EXPECT_EQ(image.lowest, same.lowest);
      EXPECT_EQ(image.highest, same.highest);
      EXPECT_EQ(files.hash(path), direct->hash(path));
    }

  scene::MeshFileRequest damaged = request;
  damaged.options.path = "damaged.obj";
  EXPECT_EQ(thrown_by([&] { files.mesh(damaged, where); }).message,
            thrown_by([&] { direct->mesh(damaged, where); }).message);
  damaged.options.path = "none.obj";
  EXPECT_EQ(thrown_by([&] { files.mesh(damaged, where); }).message,
            thrown_by([&] { direct->mesh(damaged, where); }).message);
  // One error does not end the process.
  EXPECT_EQ(files.mesh(request, where).triangles.size(), 1u);
}

TEST(ReaderHost, ACrashIsOneErrorThatNamesTheFile) {
  const Thrown thrown = thrown_when_parsing(misbehaving([] { std::abort(); }));
  EXPECT_EQ(thrown.reason, "SCENE_READER_CRASHED");
  EXPECT_NE(thrown.message.find("'scene.xml'"), std::string::npos) << thrown.message;
  EXPECT_EQ(thrown_when_parsing(misbehaving([] { std::raise(SIGXCPU); })).reason, "FILE_TAKES_TOO_LONG");
  // As the kernel does when memory runs out.
  EXPECT_EQ(thrown_when_parsing(misbehaving([] { std::raise(SIGKILL); })).reason,
            "FILE_TAKES_TOO_MUCH_MEMORY");
}

TEST(ReaderHost, NonsenseIsRefused) {
  const Thrown thrown = thrown_when_parsing([](const Socket& server) {
    server.receive_value<MessageHeader>();
    server.send_value(MessageHeader{.kind = 77, .reserved = 0, .bytes = 0});
  });
  EXPECT_EQ(thrown.reason, "SCENE_READER_CRASHED");
}

TEST(ReaderHost, ReadersCanReachNothing) {
  ReaderHost host([](const Socket& server) {
    const auto denied = [&](bool failed) { server.send_value(static_cast<uint8_t>(failed)); };
    denied(::open("/etc/passwd", O_RDONLY) < 0);
    denied(::open("/dev/null", O_RDWR) < 0);
    denied(::mkdir("/tmp/made-by-a-reader", 0700) < 0);
    denied(::mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED);
    denied(::malloc(ReaderLimits::memory_bytes + (size_t{1} << 30)) == nullptr);
    denied(::write(4, "x", 1) < 0);  // there is nothing but its socket
    denied(::syscall(SYS_clone, SIGCHLD, nullptr, nullptr, nullptr, nullptr) < 0);
  });
  const ReaderProcess reader = host.start_reader();
  if (reader.confinement.seccomp_error != 0) GTEST_SKIP() << "seccomp is not to be had here";
  for (int i = 0; i < 7; ++i) EXPECT_EQ(reader.data.receive_value<uint8_t>(), 1) << i;
}

TEST(ReaderHost, SaysHowReadersAreConfined) {
  ReaderHost host([](const Socket&) {});
  EXPECT_FALSE(host.confinement());
  const Confinement of_reader = host.start_reader().confinement;
  const std::optional<Confinement> said = host.confinement();
  ASSERT_TRUE(said);
  EXPECT_EQ(said->limits_error, 0);
  EXPECT_EQ(said->seccomp_error, of_reader.seccomp_error);
  EXPECT_EQ(said->landlock_error, of_reader.landlock_error);
}

TEST(Confinement, LayersThatAreMissingSayWhy) {
  const auto layers = layers_of({.limits_error = 0, .seccomp_error = EPERM, .landlock_error = ENOSYS});
  ASSERT_EQ(layers.size(), 3u);
  EXPECT_STREQ(layers[0].name, "rlimits");
  EXPECT_EQ(layers[0].problem, "");
  EXPECT_STREQ(layers[1].name, "seccomp");
  EXPECT_EQ(layers[1].problem, "Operation not permitted");
  EXPECT_STREQ(layers[2].name, "landlock");
  EXPECT_EQ(layers[2].problem, "Function not implemented");
}

TEST(ReaderHost, IntrudersAreEnded) {
  for (const auto& misdeed :
       std::initializer_list<std::function<void()>>{[] { ::socket(AF_INET, SOCK_STREAM, 0); },
                                                    [] {
                                                      char* const arguments[] = {nullptr};
                                                      ::execve("/bin/true", arguments, arguments);
                                                    },
                                                    [] { ::kill(::getppid(), SIGKILL); }}) {
    ReaderHost host(misbehaving(misdeed));
    const ReaderProcess reader = host.start_reader();
    if (reader.confinement.seccomp_error != 0) GTEST_SKIP() << "seccomp is not to be had here";
    const std::optional<int> status = reader.wait_status();
    ASSERT_TRUE(status);
    EXPECT_TRUE(WIFSIGNALED(*status) && WTERMSIG(*status) == SIGSYS) << *status;
  }
}

TEST(ReaderHost, AReaderEndsWithItsScene) {
  ReaderHost host([](const Socket& server) {
    server.send_value(::getpid());
    while (true) ::sched_yield();
  });
  pid_t process = -1;
  {
    const ReaderProcess reader = host.start_reader();
    process = reader.data.receive_value<pid_t>();
    EXPECT_EQ(::kill(process, 0), 0);
  }
  while (::kill(process, 0) == 0) std::this_thread::yield();  // CTest's limit is against hanging
  EXPECT_EQ(errno, ESRCH);
}

}  // namespace
}  // namespace fogbank::service
