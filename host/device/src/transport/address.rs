//! What a device may be called on the command line.

use std::fmt;
use std::str::FromStr;

use serialport::{SerialPortInfo, SerialPortType};

use crate::error::LinkError;

/// Where a device is to be found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A serial port or pseudo-terminal, by its path (`/dev/ttyACM0`, `/dev/pts/3`, `COM3`).
    Serial(String),
    /// A device behind a TCP port: `tcp:HOST:PORT`.
    Tcp(String),
    /// A simulated device inside this process: `sim:` or `sim:SEED`.
    Simulated {
        /// Seed of everything random in the simulation.
        seed: u64,
    },
    /// What another session went by, kept in a file: `file:RUN.mcap`.
    Recording(String),
}

impl FromStr for Address {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        let wrong = |reason| LinkError::Address { text: text.to_owned(), reason };
        if let Some(seed) = text.strip_prefix("sim:") {
            let seed = if seed.is_empty() { Ok(0) } else { seed.parse() };
            return seed
                .map(|seed| Self::Simulated { seed })
                .map_err(|_| wrong("what follows `sim:` is a seed, a whole number"));
        }
        if let Some(path) = text.strip_prefix("file:") {
            return match path {
                "" => Err(wrong("what follows `file:` is the path of a recording")),
                path => Ok(Self::Recording(path.to_owned())),
            };
        }
        if let Some(host) = text.strip_prefix("tcp:") {
            return match host.rsplit_once(':') {
                Some((name, port)) if !name.is_empty() && port.parse::<u16>().is_ok() => Ok(Self::Tcp(host.to_owned())),
                _ => Err(wrong("a TCP device is written tcp:HOST:PORT, for example tcp:localhost:7800")),
            };
        }
        if text.is_empty() { Err(wrong("it is empty")) } else { Ok(Self::Serial(text.to_owned())) }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(path) => f.write_str(path),
            Self::Tcp(host) => write!(f, "tcp:{host}"),
            Self::Simulated { seed } => write!(f, "sim:{seed}"),
            Self::Recording(path) => write!(f, "file:{path}"),
        }
    }
}

/// A serial port that this machine lists, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// What to give as the device's name.
    pub path: String,
    /// What is known of the hardware behind it.
    pub description: String,
    /// Whether it is a USB device, which a finger's board is.
    pub usb: bool,
}

impl From<SerialPortInfo> for Port {
    fn from(info: SerialPortInfo) -> Self {
        let (description, usb) = match info.port_type {
            SerialPortType::UsbPort(usb) => {
                let words = [usb.manufacturer, usb.product, usb.serial_number.map(|number| format!("serial {number}"))];
                let words: Vec<String> = words.into_iter().flatten().collect();
                (format!("USB {:04x}:{:04x} {}", usb.vid, usb.pid, words.join(", ")).trim_end().to_owned(), true)
            }
            SerialPortType::PciPort => ("built in".to_owned(), false),
            SerialPortType::BluetoothPort => ("Bluetooth".to_owned(), false),
            SerialPortType::Unknown => (String::new(), false),
        };
        Self { path: info.port_name, description, usb }
    }
}

/// The serial ports that this machine lists, USB devices first. Pseudo-terminals are never listed.
///
/// # Errors
/// [`LinkError::Listing`] if the operating system does not say.
pub fn ports() -> Result<Vec<Port>, LinkError> {
    let listed = serialport::available_ports().map_err(|error| LinkError::Listing { reason: error.to_string() })?;
    let mut ports: Vec<Port> = listed.into_iter().map(Port::from).collect();
    ports.sort_by(|a, b| b.usb.cmp(&a.usb).then_with(|| a.path.cmp(&b.path)));
    Ok(ports)
}

/// The device to use when none was named: the one USB serial port among `ports`.
///
/// Nothing is sent to find out what a port is: that could disturb somebody else's instrument.
///
/// # Errors
/// [`LinkError::NothingFound`] or [`LinkError::SeveralFound`].
pub fn only_device(ports: &[Port]) -> Result<Address, LinkError> {
    let usb: Vec<&Port> = ports.iter().filter(|port| port.usb).collect();
    match usb.as_slice() {
        [port] => Ok(Address::Serial(port.path.clone())),
        [] => Err(LinkError::NothingFound),
        several => Err(LinkError::SeveralFound { paths: several.iter().map(|port| port.path.clone()).collect() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, usb: bool) -> Port {
        Port { path: path.to_owned(), description: String::new(), usb }
    }

    #[test]
    fn names_are_read_as_they_are_printed() {
        for text in ["/dev/ttyACM0", "COM3", "tcp:localhost:7800", "tcp:[::1]:7800", "sim:0", "sim:42", "file:run.mcap"]
        {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
        assert_eq!("sim:".parse::<Address>().unwrap(), Address::Simulated { seed: 0 });
    }

    #[test]
    fn a_name_that_cannot_be_meant_says_what_is_wrong() {
        for text in ["", "tcp:", "tcp:localhost", "tcp::80", "tcp:h:99999", "sim:blue", "file:"] {
            let message = text.parse::<Address>().unwrap_err().to_string();
            assert!(message.contains(&format!("`{text}`")), "{message}");
        }
    }

    #[test]
    fn one_usb_port_is_taken_without_asking_and_none_or_two_are_not() {
        let (built_in, one, two) = (port("/dev/ttyS0", false), port("/dev/ttyACM0", true), port("/dev/ttyACM1", true));
        assert_eq!(only_device(&[built_in.clone(), one.clone()]).unwrap(), Address::Serial("/dev/ttyACM0".into()));
        assert!(matches!(only_device(&[built_in]), Err(LinkError::NothingFound)));
        assert!(matches!(only_device(&[one, two]), Err(LinkError::SeveralFound { paths }) if paths.len() == 2));
    }
}
