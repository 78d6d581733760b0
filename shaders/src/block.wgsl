// What a block is made of beside its coefficients; this text stands before the kernels of the
// inverse problem, after level.wgsl.
struct Block {
    spacing: vec3<f32>,        // mm
    volume: f32,               // of a cell, mm³
    smoothness: vec3<f32>,     // weight of a step across a face of each axis
    boundary_constant: f32,    // C
    origin: vec2<f32>,         // log κ and log μ that the range is about
    range: f32,                // how far from it they may go
    unscale: f32,              // by what weights were multiplied, inversely
    drive: f32,                // the surface model's, see SurfaceModel in diffusion/src/surface.rs
    beam: f32,
    exit_per_flux: f32,
    exit_per_irradiance: f32,
    lit_front: u32,            // 1 if the light falls on the face that the camera sees
    closed: u32,               // 1 if no light passes the lateral faces
    free_gain: u32,
    pull: f32,                 // what one cell's distance from the origin counts, squared
    per_edge: f32,             // one over the step beyond which edges begin, or 0
    stam: u32,                 // 1 if the unknown is κφ, see Operator in diffusion/src/operator.rs
    asymptotic: u32,           // 1 if D conducts in κ's place, see diffusion/src/conduction.rs
    of_mu: f32,                // what the smoothness of log μ counts
}

@group(1) @binding(0) var<storage, read> block: Block;

// What enters through a face along z for one unit of light outside, from what leaves through it for one
// unit of the unknown.
fn entrance(leaves: f32) -> f32 {
    let area = block.spacing.x * block.spacing.y;
    let of_kappa_phi = (area - 0.5 * block.spacing.z * leaves) / (2.0 * block.boundary_constant);
    return select(leaves, of_kappa_phi, block.stam == 1u);
}

// What conducts, κ or D, and its derivatives by κ and by μ.
fn conducting(kappa: f32, mu: f32) -> vec3<f32> {
    if block.asymptotic == 0u {
        return vec3(kappa, 1.0, 0.0);
    }
    let a = 3.0 * kappa * mu;
    if a >= 1.0 {
        return vec3(3.0 * kappa, 3.0, 0.0);
    }
    let p = 0.8;
    let q = 108.0 / 175.0;
    let r = 2.0 - p - q;
    let ratio = 1.0 + a * (p + a * (q + a * r));
    let slope = p + a * (2.0 * q + a * 3.0 * r);
    return vec3(kappa * ratio, ratio + a * slope, 3.0 * kappa * kappa * slope);
}

// The cell at depth k as the light meets them.
fn lit_depth(k: u32) -> u32 {
    return select(level.cells.z - 1u - k, k, block.lit_front == 1u);
}
