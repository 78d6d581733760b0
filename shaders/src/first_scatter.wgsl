// The first-scatter source of a collimated beam of unit irradiance, column by column.
// Twin: first_scatter in diffusion/src/beam.rs, which says what it is.

@group(1) @binding(1) var<storage, read> kappa: array<f32>;
@group(1) @binding(2) var<storage, read> mu: array<f32>;
@group(1) @binding(3) var<storage, read_write> source: array<f32>;

@compute @workgroup_size(64)
fn first_scatter(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= level.cells.xy) {
        return;
    }
    let area = block.spacing.x * block.spacing.y;
    var depth = 0.0;
    var before = 0u;
    for (var k = 0u; k < level.cells.z; k++) {
        let cell = cell_at(vec3(id.xy, lit_depth(k)));
        let own = kappa[cell];
        let step = block.spacing.z / (3.0 * own);
        let diffuse = (1.0 - 3.0 * own * mu[cell]) * exp(-depth) * scattered(step);
        let share = moved(own, mu[cell], k == 0u).x;
        source[cell] = area * diffuse * (1.0 - share);
        if k > 0u {
            source[before] += area * diffuse * share;
        }
        before = cell;
        depth += step;
    }
}
