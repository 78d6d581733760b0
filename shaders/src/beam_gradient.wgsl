// What the first-scatter source adds to the gradient, column by column.
// Twin: add_gradient in diffusion/src/beam.rs, which says why.

@group(1) @binding(1) var<storage, read> kappa: array<f32>;
@group(1) @binding(2) var<storage, read> mu: array<f32>;
@group(1) @binding(3) var<storage, read> irradiance: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> adjoint: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> slopes: array<f32>; // by μ from the second third on, by κ itself in the last

fn inside(cell: u32, column: u32) -> f32 {
    var weight = 0.0;
    for (var q = 0u; q < level.quads; q++) {
        weight += dot(irradiance[column * level.quads + q], adjoint[cell * level.quads + q]);
    }
    return block.beam * weight;
}

@compute @workgroup_size(64)
fn beam_gradient(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= level.cells.xy) {
        return;
    }
    let n = level.cells;
    let count = n.x * n.y * n.z;
    let column = id.y * n.x + id.x;
    let area = block.spacing.x * block.spacing.y;
    let h = block.spacing.z;
    var depth = 0.0;
    for (var k = 0u; k < n.z; k++) {
        depth += h / (3.0 * kappa[cell_at(vec3(id.xy, lit_depth(k)))]);
    }
    var behind = 0.0;
    var here = inside(cell_at(vec3(id.xy, lit_depth(n.z - 1u))), column);
    for (var k = n.z; k > 0u; k--) {
        let cell = cell_at(vec3(id.xy, lit_depth(k - 1u)));
        var before = 0.0; // what has left counts nothing
        if k > 1u {
            before = inside(cell_at(vec3(id.xy, lit_depth(k - 2u))), column);
        }
        let own = kappa[cell];
        let step = h / (3.0 * own);
        let last = exp(-depth);
        depth -= step;
        let albedo = 1.0 - 3.0 * own * mu[cell];
        let share = moved(own, mu[cell], k == 1u);
        let weight = here + share.x * (before - here);
        let lost = area * exp(-depth) * scattered(step);
        let by_extinction = h * (area * albedo * last * weight - behind);
        slopes[2u * count + cell] += albedo * lost * share.y * (before - here)
            - by_extinction / (3.0 * own * own) - 3.0 * mu[cell] * lost * weight;
        slopes[count + cell] += albedo * lost * share.z * (before - here) - 3.0 * own * lost * weight;
        behind += albedo * lost * weight;
        here = before;
    }
}
