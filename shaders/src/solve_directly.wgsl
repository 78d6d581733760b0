// x = inverse · b on the coarsest level; the dot is x · b.
// Twin: SolveDirectly in diffusion/src/cpu/multigrid.rs.

@group(1) @binding(0) var<storage, read> inverse: array<f32>;
@group(1) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(64)
fn solve_directly(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let size = level.cells.x * level.cells.y * level.cells.z;
    let quad = id.x % level.quads;
    let cell = id.x / level.quads;
    var dot = vec4(0.0);
    if cell < size {
        var sum = vec4(0.0);
        for (var j = 0u; j < size; j++) {
            sum += inverse[cell * size + j] * b[j * level.quads + quad];
        }
        x[id.x] = sum;
        dot = sum * b[id.x];
    }
    add_up(local, group, groups, dot);
}
