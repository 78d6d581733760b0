// What leaves the front face along its normal, and the sums that the best gain follows from.
// Twins: Forward::exit_radiance in diffusion/src/forward.rs, DataTerm in diffusion/src/inverse.

@group(1) @binding(1) var<storage, read> irradiance: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> fluence: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> measured: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> weight: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> radiance: array<vec4<f32>>;
@group(1) @binding(6) var<storage, read_write> partials: array<vec4<f32>>; // of every workgroup

@compute @workgroup_size(64)
fn exit_radiance(at: Invocation) {
    var own = vec4(0.0);
    if all(vec2(at.id.x / level.quads, at.id.y) < level.cells.xy) {
        // The front face's cells are the first of the block.
        let i = at.id.y * level.cells.x * level.quads + at.id.x;
        let leaves = face_z[i / level.quads];
        let outside = entrance(leaves) * block.drive;
        let light = select(vec4(0.0), irradiance[i], block.lit_front == 1u);
        let flux = (leaves * fluence[i] - outside * light) / (block.spacing.x * block.spacing.y);
        let l = block.exit_per_flux * flux + block.exit_per_irradiance * light;
        radiance[i] = l;
        let w = max(weight[i], vec4(0.0)); // below 0 it is kept out of the fit
        own = vec4(dot(w * l, l), dot(w * l, measured[i]), 0.0, 0.0);
    }
    add_up(at, own, 1u);
}
