// high += low: the two numbers of a solution become one.

@group(1) @binding(0) var<storage, read> low: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> high: array<vec4<f32>>;

@compute @workgroup_size(64)
fn fold(@builtin(global_invocation_id) id: vec3<u32>) {
    let column = vec2(id.x / level.quads, id.y);
    if any(column >= level.cells.xy) {
        return;
    }
    let last = min((id.z + 1u) * level.planes, level.cells.z);
    for (var z = id.z * level.planes; z < last; z++) {
        let i = cell_at(vec3(column, z)) * level.quads + id.x % level.quads;
        high[i] += low[i];
    }
}
