// The dot is b · b.
// Twin: norms in diffusion/src/cpu/mod.rs.

@group(1) @binding(0) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(64)
fn square(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let column = vec2(id.x / level.quads, id.y);
    var dot = vec4(0.0);
    if all(column < level.cells.xy) {
        let last = min((id.z + 1u) * level.planes, level.cells.z);
        for (var z = id.z * level.planes; z < last; z++) {
            let own = b[cell_at(vec3(column, z)) * level.quads + id.x % level.quads];
            dot += own * own;
        }
    }
    add_up(local, group, groups, dot);
}
