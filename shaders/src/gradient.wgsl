// ∂J/∂κ and ∂J/∂μ of every cell from fluence φ and adjoint fluence w, onto what is there already. κ is what conducts,
// the coefficient itself or D: what that comes to is left to by_logs.
// Twin: Forward::gradient in diffusion/src/adjoint.rs.

@group(1) @binding(1) var<storage, read> kappa: array<f32>;
@group(1) @binding(2) var<storage, read> irradiance: array<vec4<f32>>; // of the lit face's cells
@group(1) @binding(3) var<storage, read> fluence: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> adjoint: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read> by_radiance: array<vec4<f32>>; // of the front face's cells
@group(1) @binding(6) var<storage, read_write> slopes: array<f32>; // by what conducts in all cells, then by μ

// −∂T/∂κ of this cell times Σ Δφ Δw, over an inner face; `ratio` is κ beyond / (κ here + κ beyond).
fn across(cell: u32, beyond: u32, axis: u32) -> f32 {
    if block.stam == 1u {
        return 0.0;
    }
    let own = kappa[cell];
    let other = kappa[beyond];
    let ratio = other / (own + other);
    let h = block.spacing[axis];
    var drop = 0.0;
    for (var q = 0u; q < level.quads; q++) {
        let i = cell * level.quads + q;
        let j = beyond * level.quads + q;
        drop += dot(fluence[j] - fluence[i], adjoint[j] - adjoint[i]);
    }
    return -2.0 * block.volume / (h * h) * ratio * ratio * drop;
}

// Σ w (∂g/∂κ outside − ∂e/∂κ φ), e being what leaves for one unit of the unknown and g what enters; and what
// leaves the front face directly through its own e and g.
fn surface(cell: u32, axis: u32, high: bool, leaves: f32, column: u32) -> f32 {
    let h = block.spacing[axis];
    let area = block.volume / h;
    var g_slope = leaves * leaves * h / (2.0 * area);
    var e_slope = -2.0 * block.boundary_constant * leaves * leaves / area;
    if block.stam == 0u {
        g_slope /= kappa[cell] * kappa[cell];
        e_slope = g_slope;
    }
    let lit = axis == 2u && high == (block.lit_front == 0u);
    let front = axis == 2u && !high;
    var sum = 0.0;
    for (var q = 0u; q < level.quads; q++) {
        let i = cell * level.quads + q;
        var outside = vec4(0.0);
        if lit {
            outside = block.drive * irradiance[column * level.quads + q];
        }
        var pull = adjoint[i];
        if front {
            pull -= block.exit_per_flux / area * by_radiance[column * level.quads + q];
        }
        sum += dot(pull, g_slope * outside - e_slope * fluence[i]);
    }
    return sum;
}

fn conductance(axis: u32, face: u32) -> f32 {
    switch axis {
        case 0u: { return face_x[face]; }
        case 1u: { return face_y[face]; }
        default: { return face_z[face]; }
    }
}

@compute @workgroup_size(64)
fn gradient(@builtin(global_invocation_id) place: vec3<u32>) {
    let n = level.cells;
    if any(place >= n) {
        return;
    }
    let cell = cell_at(place);
    let column = place.y * n.x + place.x;
    let step = vec3(1u, n.x, n.x * n.y);
    let low = faces_below(place);
    let high = faces_above(place);
    var by_kappa = 0.0;
    for (var a = 0u; a < 3u; a++) {
        if place[a] > 0u {
            by_kappa += across(cell, cell - step[a], a);
        } else {
            by_kappa += surface(cell, a, false, conductance(a, low[a]), column);
        }
        if place[a] + 1u < n[a] {
            by_kappa += across(cell, cell + step[a], a);
        } else {
            by_kappa += surface(cell, a, true, conductance(a, high[a]), column);
        }
    }
    var product = 0.0;
    for (var q = 0u; q < level.quads; q++) {
        let i = cell * level.quads + q;
        product += dot(fluence[i], adjoint[i]);
    }
    var by_mu = -block.volume * product;
    if block.stam == 1u {
        by_kappa += absorption[cell] / kappa[cell] * product;
        by_mu /= kappa[cell];
    }
    slopes[cell] += by_kappa;
    slopes[n.x * n.y * n.z + cell] += by_mu;
}
