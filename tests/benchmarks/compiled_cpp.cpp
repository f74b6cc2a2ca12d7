// A chain of revolute joints for Pinocchio's `aba`: accelerations at many states, and a motion by an explicit pair of
// order 8(5,3). Callers pass arrays of doubles, rows first.

#include <pinocchio/algorithm/aba.hpp>

#include <algorithm>
#include <cmath>
#include <string>

#define EXPORTED extern "C" __attribute__((visibility("default")))

namespace pin = pinocchio;
using Eigen::VectorXd;
using Rotation = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Table = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

constexpr int stages = 12, link_size = 37;
constexpr double safety = 0.8, smallest = 0.2, largest = 6.0, largest_first = 1e4;

struct Chain {
    pin::Model model;
    pin::Data data;
    pin::Convention convention;
    VectorXd q, v, torque;

    const VectorXd &accelerations(const double *at_q, const double *at_v) {
        q = Eigen::Map<const VectorXd>(at_q, model.nv);
        v = Eigen::Map<const VectorXd>(at_v, model.nv);
        return pin::aba(model, data, q, v, torque, convention);
    }
};

static pin::SE3 placement(const double *x) {
    return pin::SE3(Eigen::Map<const Rotation>(x + 3), Eigen::Map<const Eigen::Vector3d>(x));
}

// Each link: frame of its joint in the link before (p, R), frame in the link itself, mass, centre of mass, inertia.
EXPORTED Chain *new_chain(int count, const double *links, const double *gravity, int world) {
    pin::Model model;
    model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
    pin::SE3 end = pin::SE3::Identity();
    for (int n = 0; n < count; ++n) {
        const double *x = links + n * link_size;
        model.addJoint(n, pin::JointModelRZ(), end * placement(x), "j" + std::to_string(n));
        end = placement(x + 12).inverse();
        const Eigen::Matrix3d inertia = Eigen::Map<const Rotation>(x + 28);
        model.appendBodyToJoint(n + 1, pin::Inertia(x[24], Eigen::Map<const Eigen::Vector3d>(x + 25), inertia), end);
    }
    const auto convention = world ? pin::Convention::WORLD : pin::Convention::LOCAL;
    const VectorXd zero = VectorXd::Zero(count);
    return new Chain{model, pin::Data(model), convention, zero, zero, zero};
}

EXPORTED void accelerations(Chain *chain, int states, const double *q, const double *v, double *out) {
    const int n = chain->model.nv;
    for (int i = 0; i < states; ++i)
        Eigen::Map<VectorXd>(out + i * n, n) = chain->accelerations(q + i * n, v + i * n);
}

// Table of weights A (12, 12), then b, then the error estimates of fifth and of third order: 15 rows. z = (q, v) is
// overwritten by its end; counters: steps, rejected steps, evaluations. Sizes of components and control of the step are
// those of `steppers.motion` and `steppers.explicit`. Return whether the end was reached.
EXPORTED int motion(Chain *chain, const double *pair, double span, double tolerance, double *z_out, int *counters) {
    const int n = chain->model.nv;
    const Table table(pair, stages + 3, stages);
    Eigen::Map<VectorXd> z(z_out, 2 * n);
    VectorXd state(2 * n), end(2 * n), five(2 * n), three(2 * n);
    Eigen::MatrixXd K(2 * n, stages);
    std::fill(counters, counters + 3, 0);
    const auto combine = [&](int row, int count, double scale, VectorXd &sum) {
        for (int j = 0; j < count; ++j)
            if (table(row, j) != 0.0) sum.noalias() += scale * table(row, j) * K.col(j);
    };
    const auto derivative = [&](const auto &at, int i) {
        K.col(i).head(n) = at.tail(n);
        K.col(i).tail(n) = chain->accelerations(at.data(), at.data() + n);
        ++counters[2];
    };
    double t = 0.0, h = 0.0, most = largest_first;
    bool fresh = true;
    while (t < span) {
        if (fresh) derivative(z, 0);
        const double spin = std::max(1.0, z.tail(n).lpNorm<Eigen::Infinity>());
        const auto mean = [&](const auto &x) {  // of squares, in sizes: angles 1, speeds `spin`
            return (x.head(n).squaredNorm() + x.tail(n).squaredNorm() / (spin * spin)) / (2 * n);
        };
        if (h == 0.0) h = std::pow(tolerance, 0.125) / std::max(std::sqrt(mean(K.col(0))), 1.0 / span);
        const double step = h >= span - t ? span - t : std::min(h, 0.5 * (span - t));
        if (!(step >= 1e-14 * std::max(1.0, t))) return 0;
        for (int i = 1; i < stages; ++i) {
            state = z;
            combine(i, i, step, state);
            derivative(state, i);
        }
        end = z, five.setZero(), three.setZero();
        combine(stages, stages, step, end);
        combine(stages + 1, stages, 1.0, five);
        combine(stages + 2, stages, 1.0, three);
        const double e5 = mean(five), e3 = mean(three);
        const double error = e5 > 0.0 ? step * e5 / std::sqrt(e5 + 0.01 * e3) / tolerance : 0.0;
        double factor = error > 0.0 ? std::clamp(safety * std::pow(error, -0.125), smallest, most) : most;
        if (!std::isfinite(error)) factor = smallest;
        fresh = error <= 1.0;
        ++counters[fresh ? 0 : 1];
        if (!fresh) {
            h = step * factor, most = 1.0;
            continue;
        }
        z = end;
        t = step == span - t ? span : t + step;
        h = step == h ? step * factor : std::max(h, step * factor);
        most = largest;
    }
    return 1;
}
