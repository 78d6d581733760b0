// The smoothness of log κ and log μ: its gradient, and what it comes to.
// Twins: roughness and squared_distance in diffusion/src/inverse/smoothness.rs.

@group(1) @binding(1) var<storage, read> logs: array<f32>;
@group(1) @binding(2) var<storage, read_write> out: array<f32>;
@group(1) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

// 1 for a step that is small against an edge, or where none are kept.
fn stretch(step: f32) -> f32 {
    let by_edge = block.per_edge * step;
    return sqrt(1.0 + by_edge * by_edge);
}

// Σ over the faces of 2 c · step, and Σ over the faces above of c · step²; and the pull to the origin.
fn bend(place: vec3<u32>, i: u32, origin: f32) -> vec2<f32> {
    let n = level.cells;
    let step = vec3(1u, n.x, n.x * n.y);
    let own = logs[i];
    let off = own - origin;
    var out = block.pull * vec2(2.0 * off, off * off);
    for (var a = 0u; a < 3u; a++) {
        if place[a] > 0u {
            let down = own - logs[i - step[a]];
            out.x += 2.0 * block.smoothness[a] * down / stretch(down);
        }
        if place[a] + 1u < n[a] {
            let up = logs[i + step[a]] - own;
            let r = stretch(up);
            out += 2.0 * block.smoothness[a] * up * vec2(-1.0 / r, up / (1.0 + r));
        }
    }
    return out;
}

@compute @workgroup_size(64)
fn squared_gradient(at: Invocation) {
    let place = at.id;
    var own = vec4(0.0);
    if all(place < level.cells) {
        let cell = cell_at(place);
        let count = level.cells.x * level.cells.y * level.cells.z;
        let of_kappa = bend(place, cell, block.origin.x);
        let of_mu = block.of_mu * bend(place, count + cell, block.origin.y);
        out[cell] = of_kappa.x;
        out[count + cell] = of_mu.x;
        own = vec4(of_kappa.y, of_mu.y, 0.0, 0.0);
    }
    add_up(at, own, 1u);
}
