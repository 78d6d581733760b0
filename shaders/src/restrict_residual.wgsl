// out = Σ over the children of b − A x, on the coarse grid.
// Twin: RestrictResidual in diffusion/src/cpu/multigrid.rs.

@group(1) @binding(0) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> out: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return x[i];
}

@compute @workgroup_size(64)
fn restrict_residual(@builtin(global_invocation_id) id: vec3<u32>) {
    let quad = id.x % level.quads;
    let parent = vec3(id.x / level.quads, id.y, id.z);
    if any(parent >= level.coarse) {
        return;
    }
    let first = parent << level.shift;
    let end = min((parent + 1u) << level.shift, level.cells);
    var sum = vec4(0.0);
    for (var z = first.z; z < end.z; z++) {
        for (var y = first.y; y < end.y; y++) {
            for (var c = first.x; c < end.x; c++) {
                let place = vec3(c, y, z);
                let cell = cell_at(place);
                let i = cell * level.quads + quad;
                sum += b[i] - absorption[cell] * x[i] + inflow(place, i, x[i]);
            }
        }
    }
    let n = level.coarse;
    out[((parent.z * n.y + parent.y) * n.x + parent.x) * level.quads + quad] = sum;
}
