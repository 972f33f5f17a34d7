// Files below a root, and nothing else.
#include "scene/file_source.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "scene/scene_files.h"

namespace fogbank::scene::test {
namespace {

TEST(ResolvePath, JoinsAndFolds) {
  EXPECT_EQ(resolve_path("scene.xml", "mesh.ply"), "mesh.ply");
  EXPECT_EQ(resolve_path("a/b/scene.xml", "mesh.ply"), "a/b/mesh.ply");
  EXPECT_EQ(resolve_path("a/b/scene.xml", "../mesh.ply"), "a/mesh.ply");
  EXPECT_EQ(resolve_path("a/b/scene.xml", "./../../c//d/./mesh.ply"), "c/d/mesh.ply");
  EXPECT_EQ(resolve_path("scene.xml", "textures\\Sky 19.exr"), "textures/Sky 19.exr");
  EXPECT_EQ(resolve_path("scene.xml", "mesh/../mesh.ply"), "mesh.ply");
  EXPECT_EQ(resolve_path("", "...hidden"), "...hidden");
  EXPECT_EQ(resolve_path("", "100%.png"), "100%.png");
  EXPECT_EQ(resolve_path("", "\xC3\xBC.png"), "\xC3\xBC.png");
}

/// References that must never reach a file outside the root.
class PathTraversal : public ::testing::TestWithParam<std::string> {};

TEST_P(PathTraversal, IsRefused) {
  TemporaryFolder folder;
  folder.write("root/inside.txt", "inside").write("secret.txt", "secret");
  const auto files = folder_source((folder.path() / "root").string());
  const Thrown thrown = thrown_by([&] { files->read(resolve_path("scene.xml", GetParam())); });
  EXPECT_TRUE(thrown.reason == "PATH_OUTSIDE_ROOT" || thrown.reason == "FILE_NOT_FOUND")
      << thrown.reason << ": " << thrown.message;
}

INSTANTIATE_TEST_SUITE_P(
    Cases, PathTraversal,
    ::testing::Values("../secret.txt", "..", "../", "./../secret.txt", "a/../../secret.txt",
                      "a/b/../../../secret.txt", "..\\secret.txt", "a\\..\\..\\secret.txt", "..//secret.txt",
                      "inside.txt/../../secret.txt", "/etc/passwd", "//etc/passwd", "///etc/passwd",
                      "\\etc\\passwd", "\\\\server\\share\\file", "//server/share/file", "C:\\file",
                      "C:/file", "c:file", "file:///etc/passwd", "file:secret.txt", "FILE:///etc/passwd",
                      "http://localhost/x", "https://localhost/x", "ftp://localhost/x", "%2e%2e/secret.txt",
                      "%2e%2e%2fsecret.txt", "..%2fsecret.txt", "%252e%252e/secret.txt",
                      std::string("inside.txt\0.png", 15), "inside.txt\n", "\x1b[31minside.txt",
                      "inside.txt\x7f", "\xC0\xAE\xC0\xAE/secret.txt", "\xE0\x80\xAE\xE0\x80\xAE/secret.txt",
                      "\xC0\xAF"
                      "etc/passwd",
                      "\xFF\xFE", "\xED\xA0\x80", std::string(4096, 'a'), std::string(2000, '/') + "x", "",
                      "~/secret.txt", "$HOME/secret.txt", "dev/../../secret.txt"));

TEST(FolderSource, ReadsAndSaysWhatIsMissing) {
  TemporaryFolder folder;
  folder.write("a/b.txt", "content").write("empty", "");
  const auto files = folder.source();
  EXPECT_TRUE(files->exists("a/b.txt"));
  EXPECT_FALSE(files->exists("a/c.txt"));
  EXPECT_EQ(files->read("a/b.txt"), "content");
  EXPECT_EQ(files->read("empty"), "");
  const Thrown missing = thrown_by([&] { files->read("a/c.txt"); });
  EXPECT_EQ(missing.reason, "FILE_NOT_FOUND");
  EXPECT_EQ(missing.message, "file 'a/c.txt' does not exist");
  files->note_missing("x");
  EXPECT_EQ(files->missing(), std::vector<std::string>{"x"});
}

TEST(FolderSource, RefusesPathsThatAreNotNormalised) {
  TemporaryFolder folder;
  folder.write("secret.txt", "secret").write("root/a.txt", "a");
  const auto files = folder_source((folder.path() / "root").string());
  for (const std::string path : {"../secret.txt", "./a.txt", "a//b", "/a.txt", ""}) {
    EXPECT_EQ(thrown_by([&] { files->read(path); }).reason, "PATH_OUTSIDE_ROOT") << path;
    EXPECT_EQ(thrown_by([&] { files->exists(path); }).reason, "PATH_OUTSIDE_ROOT") << path;
  }
}

TEST(FolderSource, SymbolicLinks) {
  TemporaryFolder folder;
  folder.write("root/real.txt", "real")
      .write("secret.txt", "secret")
      .write("root-neighbour/file.txt", "secret");
  const auto root = folder.path() / "root";
  std::filesystem::create_symlink("real.txt", root / "good.txt");
  std::filesystem::create_symlink("../secret.txt", root / "bad.txt");
  std::filesystem::create_symlink(folder.path() / "secret.txt", root / "absolute.txt");
  std::filesystem::create_symlink("..", root / "up");
  std::filesystem::create_symlink("../root-neighbour", root / "neighbour");
  std::filesystem::create_symlink("loop", root / "loop");
  const auto files = folder_source(root.string());
  EXPECT_EQ(files->read("good.txt"), "real");
  for (const std::string path : {"bad.txt", "absolute.txt", "up/secret.txt", "neighbour/file.txt"}) {
    const Thrown thrown = thrown_by([&] { files->read(path); });
    EXPECT_EQ(thrown.reason, "PATH_OUTSIDE_ROOT") << path;
    EXPECT_EQ(thrown.message,
              "file '" + path + "' leads out of the scene's root folder through a symbolic link");
  }
  EXPECT_EQ(thrown_by([&] { files->read("loop"); }).reason, "FILE_UNREADABLE");
}

TEST(FolderSource, FifosAndFoldersAreNoFiles) {
  TemporaryFolder folder;
  folder.write("sub/file", "x");
  ASSERT_EQ(::mkfifo((folder.path() / "fifo").c_str(), 0600), 0);
  const auto files = folder.source();
  for (const std::string path : {"fifo", "sub"}) {
    const Thrown thrown = thrown_by([&] { files->read(path); });
    EXPECT_EQ(thrown.reason, "NOT_A_REGULAR_FILE");
    EXPECT_EQ(thrown.message, "file '" + path + "' is not a regular file");
  }
}

TEST(FolderSource, FilesAboveTheLimitAreNotRead) {
  TemporaryFolder folder;
  folder.write("huge", "");
  std::filesystem::resize_file(folder.path() / "huge", (uintmax_t{2} << 30) + 1);  // sparse
  const Thrown thrown = thrown_by([&] { folder.source()->read("huge"); });
  EXPECT_EQ(thrown.reason, "FILE_TOO_LARGE");
  EXPECT_EQ(thrown.message, "file 'huge' has 2147483649 bytes; at most 2147483648 are read");
}

TEST(FolderSource, RootMustBeAFolder) {
  TemporaryFolder folder;
  folder.write("file", "x");
  EXPECT_EQ(thrown_by([&] { folder_source((folder.path() / "none").string()); }).reason, "ROOT_NOT_FOUND");
  EXPECT_EQ(thrown_by([&] { folder_source((folder.path() / "file").string()); }).reason, "ROOT_NOT_FOUND");
}

TEST(BlobSource, MapsLogicalPaths) {
  TemporaryFolder folder;
  folder.write("0123", "content");
  const auto files = blob_source({{"meshes/a.ply", (folder.path() / "0123").string()}});
  EXPECT_TRUE(files->exists("meshes/a.ply"));
  EXPECT_FALSE(files->exists("0123"));
  EXPECT_EQ(files->read("meshes/a.ply"), "content");
  EXPECT_EQ(thrown_by([&] { files->read("0123"); }).reason, "FILE_NOT_FOUND");
  EXPECT_EQ(thrown_by([&] { blob_source({{"../a", "b"}}); }).reason, "PATH_OUTSIDE_ROOT");
}

}  // namespace
}  // namespace fogbank::scene::test
