// What the first-scatter source adds to the gradient, column by column.
// Twin: add_gradient in diffusion/src/beam.rs, which says why.

@group(1) @binding(1) var<storage, read> kappa: array<f32>;
@group(1) @binding(2) var<storage, read> mu: array<f32>;
@group(1) @binding(3) var<storage, read> irradiance: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> adjoint: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> slopes: array<f32>;

@compute @workgroup_size(64)
fn beam_gradient(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= level.cells.xy) {
        return;
    }
    let n = level.cells;
    let column = id.y * n.x + id.x;
    let area = block.spacing.x * block.spacing.y;
    let h = block.spacing.z;
    var depth = 0.0;
    for (var k = 0u; k < n.z; k++) {
        depth += h / (3.0 * kappa[cell_at(vec3(id.xy, lit_depth(k)))]);
    }
    var behind = 0.0;
    for (var k = n.z; k > 0u; k--) {
        let cell = cell_at(vec3(id.xy, lit_depth(k - 1u)));
        var weight = 0.0;
        for (var q = 0u; q < level.quads; q++) {
            weight += dot(irradiance[column * level.quads + q], adjoint[cell * level.quads + q]);
        }
        weight *= block.beam;
        let own = kappa[cell];
        let step = h / (3.0 * own);
        let last = exp(-depth);
        depth -= step;
        let albedo = 1.0 - 3.0 * own * mu[cell];
        let lost = area * (exp(-depth) - last) * weight;
        let by_extinction = h * (area * albedo * last * weight - behind);
        slopes[cell] -= by_extinction / (3.0 * own * own) + 3.0 * mu[cell] * lost;
        slopes[n.x * n.y * n.z + cell] -= 3.0 * own * lost;
        behind += albedo * lost;
    }
}
