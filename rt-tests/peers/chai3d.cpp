// CHAI3D's finger proxy as a program that `rt-tests stability --peers` asks: scenes and the places
// of a device come on standard input, forces and places of the proxy go to standard output.
// README.md tells the messages.

#include "clocks.h"

#include "forces/CAlgorithmFingerProxy.h"
#include "math/CQuaternion.h"
#include "world/CMesh.h"
#include "world/CWorld.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <unistd.h>

using chai3d::cVector3d;

[[noreturn]] static void fail(const std::string &what) {
    std::fprintf(stderr, "chai3d: %s\n", what.c_str());
    std::exit(1);
}

// Standard output of the start; what CHAI3D prints goes to standard error.
static FILE *answers = nullptr;

static void write_all(const void *from, size_t bytes) {
    if (std::fwrite(from, 1, bytes, answers) != bytes) fail("the answer cannot be written");
}

// The next items; false at the end of the input, before the first.
template <class Item>
static bool read_some(std::vector<Item> &to, size_t count) {
    to.resize(count);
    const size_t got = std::fread(to.data(), sizeof(Item), count, stdin);
    if (got != count && (got != 0 || std::ferror(stdin))) fail("the input ends within a message");
    return got == count;
}

template <class Item>
static std::vector<Item> read_items(size_t count) {
    std::vector<Item> items;
    if (!read_some(items, count) && count > 0) fail("the input ends within a message");
    return items;
}

// Radius of most tools of CHAI3D's examples, its units: its tolerance of 1e-4 is made for it.
static const double EXAMPLES_RADIUS = 0.01;

// A ball over one mesh.
struct Scene {
    enum Variant : uint64_t {
        // As CHAI3D's constructor has it: a constraint a step, in metres.
        DEFAULTS,
        // All constraints in each step, in units in which the ball is as large as in the examples.
        DYNAMIC,
        VARIANTS,
    };

    // The world owns the mesh.
    chai3d::cWorld world;
    chai3d::cMesh *mesh = new chai3d::cMesh();
    chai3d::cAlgorithmFingerProxy proxy;
    // Units a metre.
    double scale;
    bool started = false;

    // Numbers: radius, stiffness, damping, friction (static, dynamic), largest turn that is shaded.
    Scene(uint64_t variant, const std::vector<double> &n, const std::vector<double> &places, const std::vector<uint32_t> &corners)
        : scale(variant == DYNAMIC ? EXAMPLES_RADIUS / n[0] : 1.0) {
        for (size_t k = 0; k < places.size(); k += 3) mesh->newVertex(scale * places[k], scale * places[k + 1], scale * places[k + 2]);
        for (size_t k = 0; k < corners.size(); k += 3) mesh->newTriangle(corners[k], corners[k + 1], corners[k + 2]);
        mesh->computeAllNormals();
        mesh->m_material->setStiffness(n[1] / scale);
        mesh->m_material->setDamping(n[2] / scale);
        mesh->m_material->setStaticFriction(n[3]);
        mesh->m_material->setDynamicFriction(n[4]);
        mesh->m_material->setUseHapticShading(n[5] > 0);
        mesh->m_material->setHapticTriangleSides(true, true);
        mesh->createAABBCollisionDetector(scale * n[0]);
        world.addChild(mesh);
        if (n[5] > 0) proxy.m_forceShadingAngleThreshold = n[5];
        proxy.setProxyRadius(scale * n[0]);
        proxy.m_useDynamicProxy = variant == DYNAMIC;
    }

    // A tick: pose of the object (x y z, quaternion x y z w) and place of the device.
    void step(const double *asked, double *answer) {
        mesh->setLocalPos(scale * asked[0], scale * asked[1], scale * asked[2]);
        chai3d::cMatrix3d turn;
        chai3d::cQuaternion(asked[6], asked[3], asked[4], asked[5]).toRotMat(turn);
        mesh->setLocalRot(turn);
        const cVector3d device(scale * asked[7], scale * asked[8], scale * asked[9]);
        if (!started) {
            world.computeGlobalPositions(true);
            proxy.initialize(&world, device);
            started = true;
        }
        world.computeGlobalPositions(true);
        const cVector3d force = proxy.computeForces(device, cVector3d(0.0, 0.0, 0.0));
        const cVector3d at = proxy.getProxyGlobalPosition();
        for (int k = 0; k < 3; k++) {
            answer[k] = force(k);
            answer[3 + k] = at(k) / scale;
        }
    }
};

static const uint64_t SCENE = 1, STEPS = 2;
static const size_t ASKED = 10, ANSWERED = 7;

static std::unique_ptr<Scene> read_scene() {
    const std::vector<uint64_t> variant = read_items<uint64_t>(1);
    const std::vector<double> numbers = read_items<double>(6);
    const std::vector<uint64_t> counts = read_items<uint64_t>(2);
    const std::vector<double> places = read_items<double>(3 * counts[0]);
    const std::vector<uint32_t> corners = read_items<uint32_t>(3 * counts[1]);
    if (variant[0] >= Scene::VARIANTS) fail("no variant " + std::to_string(variant[0]));
    if (!(numbers[0] > 0)) fail("the ball has no radius");
    for (uint32_t corner : corners)
        if (corner >= counts[0]) fail("a face has no vertex " + std::to_string(corner));
    return std::make_unique<Scene>(variant[0], numbers, places, corners);
}

static void answer_steps(Scene &scene, const Reading &cost) {
    const uint64_t count = read_items<uint64_t>(1)[0];
    const std::vector<double> asked = read_items<double>(ASKED * count);
    std::vector<double> answered(ANSWERED * count);
    for (uint64_t k = 0; k < count; k++) {
        double *answer = &answered[ANSWERED * k];
        const Reading from = start();
        scene.step(&asked[ASKED * k], answer);
        answer[6] = double(ns_of(taken_since(from), cost));
    }
    write_all(answered.data(), answered.size() * sizeof(double));
    std::fflush(answers);
}

int main(int count, char **) {
    if (count != 1) fail("usage: chai3d < QUESTIONS > ANSWERS, as `rt-tests stability --peers` or --export gives them");
    answers = fdopen(dup(STDOUT_FILENO), "wb");
    if (!answers || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) fail("standard output cannot be used");
    const char hello[] = "ball 1 chai3d chai3d_dynamic\n";
    write_all(hello, std::strlen(hello));
    std::fflush(answers);
    const Reading cost = cost_of_clocks();
    std::unique_ptr<Scene> scene;
    for (std::vector<uint64_t> kind; read_some(kind, 1);) {
        if (kind[0] == SCENE)
            scene = read_scene();
        else if (kind[0] == STEPS && scene)
            answer_steps(*scene, cost);
        else
            fail("message " + std::to_string(kind[0]) + " is none that may come here");
    }
    return 0;
}
