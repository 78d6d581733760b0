// high += low: the two numbers of a solution become one.

@group(1) @binding(0) var<storage, read> low: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> high: array<vec4<f32>>;

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    high[i] += low[i];
    return vec4(0.0);
}

@compute @workgroup_size(64)
fn fold(@builtin(global_invocation_id) id: vec3<u32>) {
    walk(id);
}
