// How far the radiance is from the measured one, ∂J/∂L, and the adjoint problem's right-hand side
// on the front face's cells (the rest of it is 0).
// Twin: DataTerm::evaluate in diffusion/src/inverse/data_term.rs.

@group(1) @binding(1) var<storage, read> totals: array<vec4<f32>>; // 0: Σ w L², Σ w L measured
@group(1) @binding(2) var<storage, read> radiance: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> measured: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> weight: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> by_radiance: array<vec4<f32>>;
@group(1) @binding(6) var<storage, read_write> b: array<vec4<f32>>;
@group(1) @binding(7) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(64)
fn misfit(at: Invocation) {
    var own = vec4(0.0);
    if all(vec2(at.id.x / level.quads, at.id.y) < level.cells.xy) {
        let i = at.id.y * level.cells.x * level.quads + at.id.x;
        var gain = 1.0;
        if block.free_gain == 1u && totals[0].x > 0.0 {
            gain = totals[0].y / totals[0].x;
        }
        let g = face_z[i / level.quads] / (block.spacing.x * block.spacing.y);
        let r = gain * radiance[i] - measured[i];
        let w = max(weight[i], vec4(0.0)); // below 0 it is kept out of the fit
        let slope = 2.0 * gain * w * r;
        by_radiance[i] = slope;
        b[i] = block.exit_per_flux * g * slope;
        let seen = select(vec4(0.0), vec4(1.0), w > vec4(0.0));
        own = vec4(dot(w * r, r), dot(seen * r, r), dot((w - weight[i]) * r, r), 0.0);
    }
    add_up(at, own, 1u);
}
