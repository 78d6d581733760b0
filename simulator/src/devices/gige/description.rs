//! What the camera on the network says of itself: its description by GenApi (GenICam standard,
//! GenApi 2.1), which is where drivers find its features and the registers behind them.

use std::fmt::Write;

/// Registers, as Aravis' fake camera has them; it lives by those below 0x400.
pub mod register {
    pub const WIDTH: u32 = 0x100;
    pub const HEIGHT: u32 = 0x104;
    pub const SENSOR_HEIGHT: u32 = 0x118;
    pub const SENSOR_WIDTH: u32 = 0x11C;
    pub const EXPOSURE_US: u32 = 0x120;
    pub const ACQUISITION: u32 = 0x124;
    pub const PIXEL_FORMAT: u32 = 0x128;
    pub const ACQUISITION_MODE: u32 = 0x12C;
    pub const OFFSET_X: u32 = 0x130;
    pub const OFFSET_Y: u32 = 0x134;
    pub const TRIGGER_MODE: u32 = 0x300;
    pub const TRIGGER_SOURCE: u32 = 0x304;
    /// Ours: whoever wants a frame writes 1.
    pub const REQUEST: u32 = 0x400;
    /// Ours: thousandths of a degree above absolute zero, so that no sign is needed.
    pub const TEMPERATURE_MK: u32 = 0x404;
    /// GigE Vision's own: its address.
    pub const ADDRESS: u32 = 0x24;
    /// GigE Vision's own: where the stream goes, and bytes a packet of it.
    pub const STREAM_PORT: u32 = 0xD00;
    pub const STREAM_ADDRESS: u32 = 0xD18;
    pub const PACKET_SIZE: u32 = 0xD04;
    /// GigE Vision's own: who made it and what it is, 32 bytes each.
    pub const MAKER: u32 = 0x48;
    pub const MODEL: u32 = 0x68;
}

/// Exposures that it takes, microseconds.
pub const EXPOSURES_US: [u32; 2] = [10, 60_000_000];
/// Freezing water, thousandths of a degree above absolute zero.
pub const FREEZING_MK: f64 = 273_150.0;

/// What a camera is.
pub struct Description {
    pub width: u32,
    pub height: u32,
    /// Name and code of its only pixel format.
    pub format: (String, u32),
    /// Steps of width, height and where the picture begins: 2 for a mosaic.
    pub step: u32,
    pub thermometer: bool,
}

impl Description {
    pub fn xml(&self) -> String {
        use register as r;
        let mut nodes = String::new();
        let mut features = Vec::new();
        let Self { width, height, step, .. } = *self;
        for (name, address, least, most) in [
            ("Width", r::WIDTH, step, width),
            ("Height", r::HEIGHT, step, height),
            ("OffsetX", r::OFFSET_X, 0, width - step),
            ("OffsetY", r::OFFSET_Y, 0, height - step),
            ("SensorWidth", r::SENSOR_WIDTH, width, width),
            ("SensorHeight", r::SENSOR_HEIGHT, height, height),
        ] {
            features.push(name);
            integer(&mut nodes, name, address, least, most, step);
        }
        for (name, address, entries) in [
            ("PixelFormat", r::PIXEL_FORMAT, &[(&*self.format.0, self.format.1)][..]),
            ("AcquisitionMode", r::ACQUISITION_MODE, &[("Continuous", 1)]),
            ("TriggerMode", r::TRIGGER_MODE, &[("Off", 0), ("On", 1)]),
            ("TriggerSource", r::TRIGGER_SOURCE, &[("Software", 1)]),
        ] {
            features.push(name);
            enumeration(&mut nodes, name, address, entries);
        }
        // There is one trigger only, but drivers want to choose it.
        features.push("TriggerSelector");
        nodes += "<Enumeration Name=\"TriggerSelector\"><EnumEntry Name=\"FrameStart\">\
                  <Value>0</Value></EnumEntry><Value>0</Value></Enumeration>\n";
        for (name, address, value) in [
            ("AcquisitionStart", r::ACQUISITION, 1),
            ("AcquisitionStop", r::ACQUISITION, 0),
            ("TriggerSoftware", r::REQUEST, 1),
        ] {
            features.push(name);
            let behind = format!("{name}Register");
            let _ = writeln!(
                nodes,
                "<Command Name=\"{name}\"><pValue>{behind}</pValue>\
                 <CommandValue>{value}</CommandValue></Command>"
            );
            integer_register(&mut nodes, &behind, address);
        }
        features.push("ExposureTime");
        let [shortest, longest] = EXPOSURES_US;
        float(&mut nodes, "ExposureTime", r::EXPOSURE_US, "us", ("FROM", "TO"), |nodes| {
            let _ = write!(nodes, "<Min>{shortest}</Min><Max>{longest}</Max>");
        });
        if self.thermometer {
            features.push("DeviceTemperature");
            let scale = (
                &*format!("FROM * 1000 + {FREEZING_MK}"),
                &*format!("(TO - {FREEZING_MK}) / 1000"),
            );
            float(&mut nodes, "DeviceTemperature", r::TEMPERATURE_MK, "C", scale, |_| {});
        }
        let bytes = if self.format.1 >> 16 & 0xFF == 8 { 1 } else { 2 };
        features.push("PayloadSize");
        let _ = writeln!(
            nodes,
            "<IntSwissKnife Name=\"PayloadSize\"><pVariable Name=\"W\">Width</pVariable>\
             <pVariable Name=\"H\">Height</pVariable><Formula>W * H * {bytes}</Formula>\
             </IntSwissKnife>"
        );
        let features: String =
            features.iter().map(|name| format!("<pFeature>{name}</pFeature>")).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n\
             <RegisterDescription ModelName=\"simulated\" VendorName=\"Diaphane\" \
             ToolTip=\"Simulated camera\" StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" \
             SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" \
             MinorVersion=\"0\" SubMinorVersion=\"0\" ProductGuid=\"0\" VersionGuid=\"0\" \
             xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n\
             <Category Name=\"Root\">{features}</Category>\n{nodes}<Port Name=\"Device\"/>\n\
             </RegisterDescription>\n"
        )
    }
}

fn integer(nodes: &mut String, name: &str, address: u32, least: u32, most: u32, step: u32) {
    let behind = format!("{name}Register");
    let _ = writeln!(
        nodes,
        "<Integer Name=\"{name}\"><pValue>{behind}</pValue><Min>{least}</Min><Max>{most}</Max>\
         <Inc>{step}</Inc></Integer>"
    );
    integer_register(nodes, &behind, address);
}

fn integer_register(nodes: &mut String, name: &str, address: u32) {
    let _ = writeln!(
        nodes,
        "<IntReg Name=\"{name}\"><Address>{address}</Address><Length>4</Length>\
         <AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>\
         <Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    );
}

fn enumeration(nodes: &mut String, name: &str, address: u32, entries: &[(&str, u32)]) {
    let behind = format!("{name}Register");
    let entries: String = entries
        .iter()
        .map(|(entry, value)| {
            format!("<EnumEntry Name=\"{entry}\"><Value>{value}</Value></EnumEntry>")
        })
        .collect();
    let _ = writeln!(
        nodes,
        "<Enumeration Name=\"{name}\">{entries}<pValue>{behind}</pValue></Enumeration>"
    );
    integer_register(nodes, &behind, address);
}

/// A number with a fraction, by formulas to and from a register without.
fn float(
    nodes: &mut String,
    name: &str,
    address: u32,
    unit: &str,
    (to, from): (&str, &str),
    limits: impl Fn(&mut String),
) {
    let (converter, behind) = (format!("{name}Converter"), format!("{name}Register"));
    let _ = write!(nodes, "<Float Name=\"{name}\"><pValue>{converter}</pValue>");
    limits(nodes);
    let _ = writeln!(nodes, "<Unit>{unit}</Unit></Float>");
    let _ = writeln!(
        nodes,
        "<Converter Name=\"{converter}\"><FormulaTo>{to}</FormulaTo>\
         <FormulaFrom>{from}</FormulaFrom><pValue>{behind}</pValue></Converter>"
    );
    integer_register(nodes, &behind, address);
}
