// Asks Embree and FCL what `rt-tests compare --export DIR` asked ours and parry, and times each
// question alone: usage `peers DIR`. README.md tells the files.

#include "clocks.h"

#include <embree3/rtcore.h>
#include <fcl/fcl.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

using Point = fcl::Vector3d;

struct Mesh {
    std::vector<Point> vertices;
    std::vector<fcl::Triangle> faces;
};

[[noreturn]] static void fail(const std::string &what) {
    std::fprintf(stderr, "peers: %s\n", what.c_str());
    std::exit(1);
}

static std::vector<char> read_file(const std::string &path) {
    FILE *file = std::fopen(path.c_str(), "rb");
    if (!file) fail(path + " cannot be read");
    std::vector<char> bytes;
    char block[1 << 16];
    for (size_t n; (n = std::fread(block, 1, sizeof block, file)) > 0;) bytes.insert(bytes.end(), block, block + n);
    std::fclose(file);
    return bytes;
}

static std::vector<double> read_numbers(const std::string &path) {
    const std::vector<char> bytes = read_file(path);
    const double *first = reinterpret_cast<const double *>(bytes.data());
    return std::vector<double>(first, first + bytes.size() / sizeof(double));
}

static Mesh read_mesh(const std::string &path) {
    const std::vector<char> bytes = read_file(path);
    if (bytes.size() < 16) fail(path + " is no mesh");
    const uint64_t *counts = reinterpret_cast<const uint64_t *>(bytes.data());
    if (bytes.size() != 16 + 24 * counts[0] + 12 * counts[1]) fail(path + " is no mesh");
    const double *p = reinterpret_cast<const double *>(bytes.data() + 16);
    const uint32_t *f = reinterpret_cast<const uint32_t *>(bytes.data() + 16 + 24 * counts[0]);
    Mesh mesh;
    for (uint64_t k = 0; k < counts[0]; k++, p += 3) mesh.vertices.emplace_back(p[0], p[1], p[2]);
    for (uint64_t k = 0; k < counts[1]; k++, f += 3) mesh.faces.emplace_back(f[0], f[1], f[2]);
    return mesh;
}

// Bytes that are read to sweep a core's own caches, as in rt-tests/src/commands/compare/timing.rs.
static const size_t SWEPT_BYTES = size_t(4) << 20;

// Puts every question once, in order, and writes the time and the answer of each.
template <class Ask>
static void ask_all(const std::string &folder, const std::string &name, size_t count, bool swept, Ask ask) {
    const Reading cost = cost_of_clocks();
    std::vector<unsigned char> sweep(swept ? SWEPT_BYTES : 0, 1);
    volatile unsigned char sink = 0;
    std::vector<double> out, sorted;
    for (size_t k = 0; k < count; k++) {
        unsigned char sum = 0;
        for (size_t at = 0; at < sweep.size(); at += 64) sum += sweep[at];
        sink = sum;
        const Reading from = start();
        const double answer = ask(k);
        const int64_t ns = ns_of(taken_since(from), cost);
        out.push_back(double(ns));
        out.push_back(answer);
        sorted.push_back(double(ns));
    }
    (void)sink;
    const std::string path = folder + "/" + name + ".answers";
    FILE *file = std::fopen(path.c_str(), "wb");
    if (!file || std::fwrite(out.data(), sizeof(double), out.size(), file) != out.size()) fail(path + " cannot be written");
    std::fclose(file);
    std::sort(sorted.begin(), sorted.end());
    if (!sorted.empty())
        std::fprintf(stderr, "%-34s p50 %8.0f  p99 %8.0f ns\n", name.c_str(), sorted[count / 2], sorted[count * 99 / 100]);
}

// The closest point on a triangle by Voronoi regions (Ericson 2005, 5.1.5), in single precision.
struct Vec {
    float x, y, z;
};
static inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
static inline float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Vec closest_on_triangle(Vec p, Vec a, Vec b, Vec c) {
    const Vec ab = b - a, ac = c - a, ap = p - a;
    const float d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return a;
    const Vec bp = p - b;
    const float d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return b;
    const float vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + ab * (d1 / (d1 - d3));
    const Vec cp = p - c;
    const float d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return c;
    const float vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + ac * (d2 / (d2 - d6));
    const float va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    const float one_over = 1 / (va + vb + vc);
    return a + ab * (vb * one_over) + ac * (vc * one_over);
}

struct Scene {
    RTCDevice device;
    RTCScene scene;
    const float *vertices;
    const unsigned *faces;

    explicit Scene(const Mesh &mesh) : device(rtcNewDevice("threads=1")), scene(rtcNewScene(device)) {
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        float *v = static_cast<float *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
        unsigned *f = static_cast<unsigned *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.faces.size()));
        for (size_t k = 0; k < 3 * mesh.vertices.size(); k++) v[k] = float(mesh.vertices[k / 3][k % 3]);
        for (size_t k = 0; k < 3 * mesh.faces.size(); k++) f[k] = unsigned(mesh.faces[k / 3][k % 3]);
        vertices = v;
        faces = f;
        rtcSetGeometryPointQueryFunction(geometry, try_face);
        rtcSetGeometryUserData(geometry, this);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
    }

    ~Scene() {
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }

    Vec vertex(unsigned k) const { return {vertices[3 * k], vertices[3 * k + 1], vertices[3 * k + 2]}; }

    float distance_to(Vec p, unsigned face) const {
        const unsigned *f = faces + 3 * face;
        const Vec to = p - closest_on_triangle(p, vertex(f[0]), vertex(f[1]), vertex(f[2]));
        return std::sqrt(dot(to, to));
    }

    struct Found {
        const Scene *scene;
        unsigned face;
        float distance;
    };

    static bool try_face(RTCPointQueryFunctionArguments *asked) {
        Found *found = static_cast<Found *>(asked->userPtr);
        const Vec p{asked->query->x, asked->query->y, asked->query->z};
        const float distance = found->scene->distance_to(p, asked->primID);
        if (distance >= asked->query->radius) return false;
        asked->query->radius = distance;
        found->distance = distance;
        found->face = asked->primID;
        return true;
    }

    // The nearest face within a radius.
    Found nearest(Vec p, float radius) const {
        RTCPointQuery query;
        query.x = p.x;
        query.y = p.y;
        query.z = p.z;
        query.time = 0;
        query.radius = radius;
        RTCPointQueryContext context;
        rtcInitPointQueryContext(&context);
        Found found{this, RTC_INVALID_GEOMETRY_ID, std::numeric_limits<float>::infinity()};
        rtcPointQuery(scene, &query, &context, nullptr, &found);
        return found;
    }
};

static void ask_embree(const std::string &folder, const Mesh &mesh, const std::vector<double> &tips) {
    const Scene scene(mesh);
    const size_t count = tips.size() / 3;
    auto tip = [&](size_t k) { return Vec{float(tips[3 * k]), float(tips[3 * k + 1]), float(tips[3 * k + 2])}; };
    const float infinite = std::numeric_limits<float>::infinity();
    ask_all(folder, "embree.closest_path", count, false, [&](size_t k) { return double(scene.nearest(tip(k), infinite).distance); });
    for (bool swept : {false, true}) {
        unsigned last = RTC_INVALID_GEOMETRY_ID;
        const std::string name = swept ? "embree.closest_path_cold" : "embree.closest_path_memory";
        ask_all(folder, name, count, swept, [&](size_t k) {
            const Vec p = tip(k);
            float known = infinite;
            if (last != RTC_INVALID_GEOMETRY_ID) known = scene.distance_to(p, last);
            // Only what is nearer than the face of the last answer is looked for.
            const Scene::Found found = scene.nearest(p, known);
            if (found.face == RTC_INVALID_GEOMETRY_ID) return double(known);
            last = found.face;
            return double(found.distance);
        });
    }
}

template <class Box>
static std::shared_ptr<fcl::BVHModel<Box>> tree_over(const Mesh &mesh) {
    auto tree = std::make_shared<fcl::BVHModel<Box>>();
    tree->beginModel(int(mesh.faces.size()), int(mesh.vertices.size()));
    tree->addSubModel(mesh.vertices, mesh.faces);
    tree->endModel();
    return tree;
}

// A set of pairs as one number, whatever their order: as `Digest` of
// rt-tests/src/commands/compare/tools.rs.
struct Digest {
    uint64_t sum = 0;
    void add(uint32_t a, uint32_t b) {
        uint64_t z = (uint64_t(a) << 32 | b) + 0x9E3779B97F4A7C15u;
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
        z = (z ^ z >> 27) * 0x94D049BB133111EBu;
        sum += z ^ z >> 31;
    }
    double number() const { return double(sum >> 11); }
};

// Contacts that an answer may have.
static const size_t MAX_CONTACTS = 100000;

template <class Box>
static double pairs(const fcl::BVHModel<Box> &mesh, const fcl::BVHModel<Box> &tool, const fcl::Transform3d &pose) {
    const fcl::CollisionRequestd request(MAX_CONTACTS, false);
    fcl::CollisionResultd result;
    fcl::collide(&mesh, fcl::Transform3d::Identity(), &tool, pose, request, result);
    Digest digest;
    for (size_t k = 0; k < result.numContacts(); k++) {
        const fcl::Contactd &contact = result.getContact(k);
        digest.add(uint32_t(contact.b1), uint32_t(contact.b2));
    }
    return digest.number();
}

static void ask_fcl(const std::string &folder, const Mesh &mesh, const std::vector<double> &tips) {
    const auto oriented = tree_over<fcl::OBBRSSd>(mesh);
    const auto along_axes = tree_over<fcl::AABBd>(mesh);
    const auto still = fcl::Transform3d::Identity();
    // FCL has no points: the smallest sphere that it takes for one.
    const fcl::Sphered point(1e-12);
    ask_all(folder, "fcl.closest_path", tips.size() / 3, false, [&](size_t k) {
        fcl::Transform3d at = still;
        at.translation() = Point(tips[3 * k], tips[3 * k + 1], tips[3 * k + 2]);
        const fcl::DistanceRequestd request;
        fcl::DistanceResultd result;
        fcl::distance(&point, at, oriented.get(), still, request, result);
        return result.min_distance;
    });
    for (const std::string faces : {"240", "960"}) {
        const Mesh tool = read_mesh(folder + "/tool" + faces + ".bin");
        const std::vector<double> numbers = read_numbers(folder + "/poses" + faces + ".bin");
        std::vector<fcl::Transform3d> poses;
        for (size_t k = 0; k + 6 < numbers.size(); k += 7) {
            const double *n = &numbers[k];
            fcl::Transform3d pose = fcl::Transform3d::Identity();
            pose.translation() = Point(n[0], n[1], n[2]);
            pose.linear() = fcl::Quaterniond(n[6], n[3], n[4], n[5]).toRotationMatrix();
            poses.push_back(pose);
        }
        const auto given = tree_over<fcl::OBBRSSd>(tool);
        ask_all(folder, "fcl.tool" + faces + "_pairs", poses.size(), false, [&](size_t k) { return pairs(*oriented, *given, poses[k]); });
        const auto moved = tree_over<fcl::AABBd>(tool);
        std::vector<Point> at(tool.vertices.size());
        ask_all(folder, "fcl_moved.tool" + faces + "_pairs", poses.size(), false, [&](size_t k) {
            for (size_t v = 0; v < at.size(); v++) at[v] = poses[k] * tool.vertices[v];
            moved->beginReplaceModel();
            moved->replaceSubModel(at);
            moved->endReplaceModel(true, true);
            return pairs(*along_axes, *moved, still);
        });
    }
}

int main(int count, char **arguments) {
    if (count != 2) fail("usage: peers DIR, a folder that `rt-tests compare --export DIR` wrote");
    const std::string folder = arguments[1];
    const Mesh mesh = read_mesh(folder + "/mesh.bin");
    const std::vector<double> tips = read_numbers(folder + "/tips.bin");
    ask_embree(folder, mesh, tips);
    ask_fcl(folder, mesh, tips);
    return 0;
}
