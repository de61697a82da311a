// Asks Embree and FCL what `rt-tests compare --export DIR` asked ours and parry, and times each
// question alone: usage `peers DIR`, or `peers DIR --turns` to be told on standard input when to
// put which of them. README.md tells the files and the lines.

#include "clocks.h"

#include <embree3/rtcore.h>
#include <fcl/fcl.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <limits>
#include <memory>
#include <sstream>
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

static void sweep() {
    static const std::vector<unsigned char> bytes(SWEPT_BYTES, 1);
    static volatile unsigned char sink;
    unsigned char sum = 0;
    for (size_t at = 0; at < bytes.size(); at += 64) sum += bytes[at];
    sink = sum;
    (void)sink;
}

// A library's way to answer the questions of a task, and what it took and answered so far.
struct Contender {
    std::string name, task;
    size_t count;
    // Whether the caches are swept before each question.
    bool swept;
    std::function<double(size_t)> ask;
    std::vector<double> out{};

    // Puts the questions from first to before last, each timed once, behind as many as `before`
    // before them: `time_stretch` of timing.rs.
    void turn(size_t first, size_t last, size_t before) {
        if (first > last || last > count) fail(name + "." + task + " has no such questions");
        sweep();
        for (size_t k = first > before ? first - before : 0; k < std::max<size_t>(first, 1) && k < count; k++) ask(k);
        const Reading cost = cost_of_clocks();
        for (size_t k = first; k < last; k++) {
            if (swept) sweep();
            const Reading from = start();
            const double answer = ask(k);
            out.push_back(double(ns_of(taken_since(from), cost)));
            out.push_back(answer);
        }
    }

    // Writes the time and the answer of each question.
    void write(const std::string &folder) const {
        const std::string path = folder + "/" + name + "." + task + ".answers";
        FILE *file = std::fopen(path.c_str(), "wb");
        if (!file || std::fwrite(out.data(), sizeof(double), out.size(), file) != out.size() || std::fclose(file) != 0)
            fail(path + " cannot be written");
        std::vector<double> sorted;
        for (size_t k = 0; k < out.size(); k += 2) sorted.push_back(out[k]);
        std::sort(sorted.begin(), sorted.end());
        if (!sorted.empty())
            std::fprintf(stderr, "%-34s p50 %8.0f  p99 %8.0f ns\n", (name + "." + task).c_str(), sorted[sorted.size() / 2],
                         sorted[sorted.size() * 99 / 100]);
    }
};

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

static void add_embree(std::vector<Contender> &all, const Mesh &mesh, const std::vector<double> &tips) {
    const auto scene = std::make_shared<const Scene>(mesh);
    const size_t count = tips.size() / 3;
    const auto tip = [&tips](size_t k) { return Vec{float(tips[3 * k]), float(tips[3 * k + 1]), float(tips[3 * k + 2])}; };
    const float infinite = std::numeric_limits<float>::infinity();
    all.push_back({"embree", "closest_path", count, false, [=](size_t k) { return double(scene->nearest(tip(k), infinite).distance); }});
    for (bool swept : {false, true}) {
        unsigned last = RTC_INVALID_GEOMETRY_ID;
        const auto ask = [=](size_t k) mutable {
            const Vec p = tip(k);
            float known = infinite;
            if (last != RTC_INVALID_GEOMETRY_ID) known = scene->distance_to(p, last);
            // Only what is nearer than the face of the last answer is looked for.
            const Scene::Found found = scene->nearest(p, known);
            if (found.face == RTC_INVALID_GEOMETRY_ID) return double(known);
            last = found.face;
            return double(found.distance);
        };
        all.push_back({"embree", swept ? "closest_path_cold" : "closest_path_memory", count, swept, ask});
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

static void add_fcl(std::vector<Contender> &all, const std::string &folder, const Mesh &mesh, const std::vector<double> &tips) {
    const auto oriented = tree_over<fcl::OBBRSSd>(mesh);
    const auto along_axes = tree_over<fcl::AABBd>(mesh);
    const auto still = fcl::Transform3d::Identity();
    // FCL has no points: the smallest sphere that it takes for one.
    const auto point = std::make_shared<const fcl::Sphered>(1e-12);
    all.push_back({"fcl", "closest_path", tips.size() / 3, false, [=, &tips](size_t k) {
        fcl::Transform3d at = still;
        at.translation() = Point(tips[3 * k], tips[3 * k + 1], tips[3 * k + 2]);
        const fcl::DistanceRequestd request;
        fcl::DistanceResultd result;
        fcl::distance(point.get(), at, oriented.get(), still, request, result);
        return result.min_distance;
    }});
    for (const std::string faces : {"240", "960"}) {
        const auto tool = std::make_shared<const Mesh>(read_mesh(folder + "/tool" + faces + ".bin"));
        const std::vector<double> numbers = read_numbers(folder + "/poses" + faces + ".bin");
        const auto poses = std::make_shared<std::vector<fcl::Transform3d>>();
        for (size_t k = 0; k + 6 < numbers.size(); k += 7) {
            const double *n = &numbers[k];
            fcl::Transform3d pose = fcl::Transform3d::Identity();
            pose.translation() = Point(n[0], n[1], n[2]);
            pose.linear() = fcl::Quaterniond(n[6], n[3], n[4], n[5]).toRotationMatrix();
            poses->push_back(pose);
        }
        const std::string task = "tool" + faces + "_pairs";
        const auto given = tree_over<fcl::OBBRSSd>(*tool);
        all.push_back({"fcl", task, poses->size(), false, [=](size_t k) { return pairs(*oriented, *given, (*poses)[k]); }});
        const auto moved = tree_over<fcl::AABBd>(*tool);
        const auto at = std::make_shared<std::vector<Point>>(tool->vertices.size());
        all.push_back({"fcl_moved", task, poses->size(), false, [=](size_t k) {
            for (size_t v = 0; v < at->size(); v++) (*at)[v] = (*poses)[k] * tool->vertices[v];
            moved->beginReplaceModel();
            moved->replaceSubModel(*at);
            moved->endReplaceModel(true, true);
            return pairs(*along_axes, *moved, still);
        }});
    }
}

// Turns as they are told, a line each: `TASK FIRST LAST BEFORE`.
static void take_turns(std::vector<Contender> &all) {
    std::cout << "ready" << std::endl;
    for (std::string line; std::getline(std::cin, line);) {
        std::istringstream words(line);
        std::string task;
        size_t first, last, before;
        if (!(words >> task >> first >> last >> before)) fail("\"" + line + "\" is no turn");
        for (Contender &one : all)
            if (one.task == task) one.turn(first, last, before);
        std::cout << "done" << std::endl;
    }
}

int main(int count, char **arguments) {
    const bool told = count == 3 && std::string(arguments[2]) == "--turns";
    if (count != 2 && !told) fail("usage: peers DIR [--turns], a folder that `rt-tests compare --export DIR` wrote");
    const std::string folder = arguments[1];
    const Mesh mesh = read_mesh(folder + "/mesh.bin");
    const std::vector<double> tips = read_numbers(folder + "/tips.bin");
    std::vector<Contender> all;
    add_embree(all, mesh, tips);
    add_fcl(all, folder, mesh, tips);
    if (told)
        take_turns(all);
    else
        for (Contender &one : all) one.turn(0, one.count, 0);
    for (const Contender &one : all) one.write(folder);
    return 0;
}
