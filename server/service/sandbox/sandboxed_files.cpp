#include "service/sandbox/sandboxed_files.h"

#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

#include "core/sha256.h"
#include "scene/text.h"
#include "scene/texture_library.h"
#include "service/sandbox/encoding.h"

namespace fogbank::service {
namespace {

/// Of descriptions and lists of paths. Far above what LoadLimits let a scene file say.
constexpr uint64_t most_text_bytes = uint64_t{1} << 30;

/// Tells whether a file was changed.
struct Stamp {
  ino_t number = 0;
  off_t size = 0;
  timespec modified{};
  timespec changed{};

  static Stamp of(const FileDescriptor& file) {
    struct stat status {};
    ::fstat(file.get(), &status);
    return {status.st_ino, status.st_size, status.st_mtim, status.st_ctim};
  }
  bool operator==(const Stamp& other) const {
    const auto same = [](const timespec& a, const timespec& b) {
      return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec;
    };
    return number == other.number && size == other.size && same(modified, other.modified) &&
           same(changed, other.changed);
  }
};

/// Leaves the descriptor's position alone, which the reading process shares.
std::string hash_of(const FileDescriptor& file) {
  Sha256 hash;
  std::string piece(size_t{1} << 20, '\0');
  for (off_t done = 0;;) {
    const ssize_t count = ::pread(file.get(), piece.data(), piece.size(), done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw Error(ErrorKind::data_loss, "FILE_UNREADABLE", "a file of the scene can't be read");
    if (count == 0) return hash.finish();
    hash.update(std::string_view(piece.data(), static_cast<size_t>(count)));
    done += count;
  }
}

}  // namespace

/// The reading process, and what is known of the files that it was given.
class SandboxedFiles::Session {
 public:
  Session(ReaderHost& host, const scene::StoredFiles& files) : files_(files), reader_(host.start_reader()) {
    reader_.data.set_patience(ReaderLimits::silence_seconds);
  }

  /// Sends a request and hands the answer's header to `read`, which takes the rest from the socket.
  template <typename Read>
  auto ask(RequestKind kind, const std::string& request, const FileDescriptor* file, AnswerKind wanted,
           const Read& read) {
    try {
      reader_.data.send_value(MessageHeader{.kind = static_cast<uint32_t>(kind), .bytes = request.size()});
      reader_.data.send(request);
      if (file != nullptr) reader_.data.send_file(file->get());
      // While the other process parses.
      if (file != nullptr) note_hash(*file);
      while (true) {
        const auto header = reader_.data.receive_value<MessageHeader>();
        const auto answer = static_cast<AnswerKind>(header.kind);
        if (answer == wanted) return read(header.bytes);
        if (answer == AnswerKind::error) throw_decoded_error(text(header.bytes));
        if (answer != AnswerKind::exists && answer != AnswerKind::open)
          throw BadMessage("an answer of no kind");
        serve(answer, text(header.bytes));
      }
    } catch (const SocketClosed&) {
      died();
    } catch (const SocketSilent&) {
      too_long();
    } catch (const BadMessage& error) {
      fail(ErrorKind::invalid_argument, "SCENE_READER_CRASHED",
           std::string("reading it led to nonsense: ") + error.what());
    }
  }

  void begin(const std::string& path, const SourceLocation& where) {
    path_ = path;
    where_ = where;
  }
  FileDescriptor open() {
    try {
      return files_.open(path_);
    } catch (const Error& error) {
      fail(error.kind(), error.reason(), error.what());
    }
  }

  std::string hash() {
    const auto known = hashes_.find(path_);
    if (known != hashes_.end()) return known->second.first;
    note_hash(files_.open(path_));
    return hashes_.at(path_).first;
  }
  /// What was parsed is what was hashed.
  void check_unchanged(const FileDescriptor& file) {
    if (!(hashes_.at(path_).second == Stamp::of(file)))
      fail(ErrorKind::failed_precondition, "FILE_CHANGED",
           "file " + scene::quote(path_) + " changes while it is read");
  }

  std::string text(uint64_t bytes) const {
    if (bytes > most_text_bytes) throw BadMessage("a message is too long");
    // Memory is taken as bytes come, not as they are promised.
    constexpr uint64_t piece = uint64_t{16} << 20;
    std::string text;
    while (text.size() < bytes) {
      const size_t begin = text.size();
      text.resize(begin + std::min(piece, bytes - begin));
      reader_.data.receive(text.data() + begin, text.size() - begin);
    }
    return text;
  }
  template <typename T>
  void receive_all(std::vector<T>& values, uint64_t count) const {
    values.resize(count);
    reader_.data.receive(values.data(), count * sizeof(T));
  }
  template <typename T>
  T receive_value() const {
    return reader_.data.receive_value<T>();
  }

 private:
  void note_hash(const FileDescriptor& file) {
    if (hashes_.contains(path_)) return;
    const Stamp stamp = Stamp::of(file);
    hashes_[path_] = {hash_of(file), stamp};
  }

  void serve(AnswerKind question, const std::string& path) {
    if (question == AnswerKind::exists) {
      bool exists = false;
      try {
        exists = files_.exists(path);
      } catch (const Error&) {  // a path that no reader of ours asks for
      }
      reader_.data.send_value(static_cast<uint8_t>(exists));
      return;
    }
    path_ = path;
    try {
      const FileDescriptor file = files_.open(path);
      reader_.data.send_value(uint8_t{1});
      reader_.data.send_file(file.get());
    } catch (const Error& error) {
      const std::string bytes = encode(error);
      reader_.data.send_value(uint8_t{0});
      reader_.data.send_value(static_cast<uint64_t>(bytes.size()));
      reader_.data.send(bytes);
    }
  }

  [[noreturn]] void too_long() const {
    fail(ErrorKind::resource_exhausted, "FILE_TAKES_TOO_LONG",
         "file " + scene::quote(path_) + " takes too long: reading a scene may take " +
             std::to_string(ReaderLimits::cpu_seconds) + " s of processor time");
  }

  [[noreturn]] void died() {
    const std::optional<int> status = reader_.wait_status();
    const std::string file = "file " + scene::quote(path_);
    if (status && WIFSIGNALED(*status)) {
      const int signal = WTERMSIG(*status);
      if (signal == SIGXCPU) too_long();
      if (signal != SIGKILL)
        fail(ErrorKind::invalid_argument, "SCENE_READER_CRASHED",
             "reading " + file + " crashed the process that does it (" + ::strsignal(signal) + ")");
    }
    fail(ErrorKind::resource_exhausted, "FILE_TAKES_TOO_MUCH_MEMORY",
         "the process that read " + file + " was killed, for want of memory as a rule");
  }

  [[noreturn]] void fail(ErrorKind kind, const std::string& reason, const std::string& message) const {
    if (where_.file.empty()) throw Error(kind, reason, message);
    throw SceneError(kind, reason, where_, message);
  }

  const scene::StoredFiles& files_;
  ReaderProcess reader_;
  std::string path_;  ///< that is being read
  SourceLocation where_;
  std::map<std::string, std::pair<std::string, Stamp>> hashes_;
};

SandboxedFiles::SandboxedFiles(ReaderHost& host, std::shared_ptr<const scene::StoredFiles> files)
    : files_(std::move(files)), session_(std::make_unique<Session>(host, *files_)) {}
SandboxedFiles::~SandboxedFiles() = default;

void SandboxedFiles::close() { session_.reset(); }

scene::ParsedScene SandboxedFiles::parse(const std::string& main_path, const scene::LoadOptions& options) {
  session_->begin(main_path, {});
  return session_->ask(RequestKind::parse, encode(ParseRequest{main_path, options}), nullptr,
                       AnswerKind::scene,
                       [&](uint64_t bytes) { return decode_scene(session_->text(bytes)); });
}

std::vector<std::string> SandboxedFiles::references(const std::string& main_path,
                                                    const scene::LoadOptions& options) {
  session_->begin(main_path, {});
  return session_->ask(RequestKind::references, encode(ParseRequest{main_path, options}), nullptr,
                       AnswerKind::references,
                       [&](uint64_t bytes) { return decode_texts(session_->text(bytes)); });
}

scene::Mesh SandboxedFiles::mesh(const scene::MeshFileRequest& request, const SourceLocation& where) {
  session_->begin(request.options.path, where);
  const FileDescriptor file = session_->open();
  scene::Mesh mesh = session_->ask(RequestKind::mesh, encode(MeshRequest{request, where}), &file,
                                   AnswerKind::mesh, [&](uint64_t bytes) {
                                     const auto header = session_->receive_value<MeshHeader>();
                                     check(header);
                                     if (bytes != sizeof header + header.bytes())
                                       throw BadMessage("a mesh of another length");
                                     scene::Mesh result;
                                     result.positions.reserve(header.positions + 1);  // mesh.h
                                     session_->receive_all(result.positions, header.positions);
                                     session_->receive_all(result.normals, header.normals);
                                     session_->receive_all(result.uvs, header.uvs);
                                     session_->receive_all(result.triangles, header.triangles);
                                     result.dropped_triangles = header.dropped_triangles;
                                     result.faceted = header.faceted != 0;
                                     check(result);
                                     return result;
                                   });
  session_->check_unchanged(file);
  return mesh;
}

scene::Image SandboxedFiles::image(const std::string& path, bool raw, const SourceLocation& where) {
  session_->begin(path, where);
  const FileDescriptor file = session_->open();
  scene::Image image = session_->ask(RequestKind::image, encode(ImageRequest{path, raw, where}), &file,
                                     AnswerKind::image, [&](uint64_t bytes) {
                                       const auto header = session_->receive_value<ImageHeader>();
                                       check(header);
                                       const uint64_t value_bytes =
                                           header.values() * (header.is_bytes != 0 ? 1 : sizeof(float));
                                       if (bytes != sizeof header + value_bytes)
                                         throw BadMessage("an image of another length");
                                       scene::Image result;
                                       result.width = header.width;
                                       result.height = header.height;
                                       result.channels = header.channels;
                                       if (header.is_bytes != 0)
                                         session_->receive_all(result.bytes, header.values());
                                       else
                                         session_->receive_all(result.data, header.values());
                                       complete(result, raw);
                                       return result;
                                     });
  session_->check_unchanged(file);
  return image;
}

std::string SandboxedFiles::hash(const std::string& path) {
  session_->begin(path, {});
  return session_->hash();
}

}  // namespace fogbank::service
