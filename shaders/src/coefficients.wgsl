// κ, μ, what conducts and absorption of every cell from their logarithms, which are held within a range.
// Twin: Objective::medium in diffusion/src/inverse.

@group(1) @binding(1) var<storage, read> logs: array<f32>; // log κ of all cells, then log μ
@group(1) @binding(2) var<storage, read_write> kappa: array<f32>;
@group(1) @binding(3) var<storage, read_write> mu: array<f32>;
@group(1) @binding(4) var<storage, read_write> conducts: array<f32>;
@group(1) @binding(5) var<storage, read_write> sink: array<f32>; // μ (of κφ: μ/κ) times the cell's volume

@compute @workgroup_size(64)
fn coefficients(@builtin(global_invocation_id) place: vec3<u32>) {
    if any(place >= level.cells) {
        return;
    }
    let cell = cell_at(place);
    let count = level.cells.x * level.cells.y * level.cells.z;
    let u = vec2(logs[cell], logs[count + cell]);
    let held = exp(clamp(u, block.origin - block.range, block.origin + block.range));
    kappa[cell] = held.x;
    mu[cell] = held.y;
    let d = conducting(held.x, held.y).x;
    conducts[cell] = d;
    sink[cell] = block.volume * held.y / select(1.0, d, block.stam == 1u);
}
