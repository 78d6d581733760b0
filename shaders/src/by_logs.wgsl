// The gradient by the logarithms from that by what conducts, μ, and κ by itself; 0 outside the range, where a coefficient no
// longer follows its logarithm.
// Twin: LogObjective::gradient in diffusion/src/inverse/data_term.rs.

@group(1) @binding(1) var<storage, read> logs: array<f32>;
@group(1) @binding(2) var<storage, read> kappa: array<f32>;
@group(1) @binding(3) var<storage, read> mu: array<f32>;
@group(1) @binding(4) var<storage, read> slopes: array<f32>;
@group(1) @binding(5) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(64)
fn by_logs(@builtin(global_invocation_id) place: vec3<u32>) {
    if any(place >= level.cells) {
        return;
    }
    let cell = cell_at(place);
    let count = level.cells.x * level.cells.y * level.cells.z;
    let u = vec2(logs[cell], logs[count + cell]);
    let value = vec2(kappa[cell], mu[cell]);
    let direct = vec2(slopes[2u * count + cell], slopes[count + cell]);
    let slope = (direct + slopes[cell] * conducting(value.x, value.y).yz) * value;
    let follows = abs(u - block.origin) <= vec2(block.range);
    let by_log = select(vec2(0.0), block.unscale * slope, follows);
    out[cell] = by_log.x;
    out[count + cell] = by_log.y;
}
