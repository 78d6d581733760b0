// Where in a cell a beam scatters; this text stands before the kernels that ask, after block.wgsl.
// Twin: diffusion/src/beam.rs, which says why.

// 1 − exp(−τ) without the cancellation of a thin cell.
fn scattered(tau: f32) -> f32 {
    return select(1.0 - exp(-tau), tau * (1.0 - 0.5 * tau * (1.0 - tau / 3.0)), tau < 0.02);
}

// How far before the middle of a cell its light scatters on average, in cells, and the derivative by τ.
// Below τ = 1 four terms of the series: closed forms lose too many of single precision's digits.
fn nearer(tau: f32) -> vec2<f32> {
    if tau < 1.0 {
        let s = tau * tau;
        return vec2(
            tau / 12.0 * (1.0 - s / 60.0 * (1.0 - s / 42.0 * (1.0 - s / 40.0))),
            (1.0 - s / 20.0 * (1.0 - s * 5.0 / 126.0 * (1.0 - s * 7.0 / 200.0))) / 12.0,
        );
    }
    let through = exp(-tau);
    let ratio = through / (1.0 - through);
    return vec2(0.5 - 1.0 / tau + ratio, 1.0 / (tau * tau) - ratio / (1.0 - through));
}

// The share of a cell's source that belongs to the cell before it, or has left if it is the first, and
// the derivatives by κ and μ.
fn moved(kappa: f32, mu: f32, first: bool) -> vec3<f32> {
    let h = block.spacing.z;
    let tau = h / (3.0 * kappa);
    var share = nearer(tau);
    share.y *= -tau / kappa;
    if !first {
        return vec3(share, 0.0);
    }
    let d = conducting(kappa, mu);
    let beyond = h / (2.0 * block.boundary_constant * d.x + 0.5 * h);
    let beyond_slope = -2.0 * block.boundary_constant / h * beyond * beyond;
    return vec3(share.x * beyond, vec2(share.y * beyond, 0.0) + share.x * beyond_slope * d.yz);
}
