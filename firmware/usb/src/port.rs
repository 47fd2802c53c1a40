//! A serial port over USB (CDC-ACM): the board's second link, on whatever USB bus there is.
//!
//! Bytes go out in packets that are never full, so each ends a transfer and the host hands it on at once; no empty
//! packets have to be sent. The port holds no bytes itself but those of one packet, in the bus's own memory.
//! Polled: [`Port::poll`] wants to be called whenever the bus has something to say.
//! Errors: none; a bus that cannot carry it gives no port.
//! Source: USB 2.0, chapter 9; CDC 1.2 and PSTN 1.2.

use usb_device::bus::{UsbBus, UsbBusAllocator};
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::{CdcAcmClass, USB_CLASS_CDC};

/// Vendor and product: the pair that Objective Development shares out for CDC-ACM devices. Who sells boards needs a
/// pair of their own.
const VENDOR_PRODUCT: UsbVidPid = UsbVidPid(0x16C0, 0x27DD);

/// Bytes in a packet at most, of the control pipe and of the data pipes: the most at full speed.
const PACKET: u16 = 64;

/// Bytes sent in a packet at most: one less than it holds.
const SENT: usize = PACKET as usize - 1;

/// Words of memory that the bus needs for what comes in: a packet of the control pipe and one of data.
pub const MEMORY_WORDS: usize = 2 * PACKET as usize / 4;

/// A serial port over USB: one stream of bytes each way.
pub struct Port<'a, B: UsbBus> {
    device: UsbDevice<'a, B>,
    class: CdcAcmClass<'a, B>,
}

impl<'a, B: UsbBus> Port<'a, B> {
    /// A port that shows up at the host with this serial number; `None` if the bus cannot carry it.
    pub fn new(bus: &'a UsbBusAllocator<B>, serial_number: &'a str) -> Option<Self> {
        let class = CdcAcmClass::new(bus, PACKET);
        let strings = StringDescriptors::default().manufacturer("palpate").product("palpate finger");
        let builder = UsbDeviceBuilder::new(bus, VENDOR_PRODUCT).device_class(USB_CLASS_CDC);
        let builder = builder.strings(&[strings.serial_number(serial_number)]).ok()?;
        Some(Self { device: builder.max_packet_size_0(PACKET.to_le_bytes()[0]).ok()?.build(), class })
    }

    /// Answers what the host wants of any USB device.
    pub fn poll(&mut self) {
        self.device.poll(&mut [&mut self.class]);
    }

    /// What has come, one packet of it; the buffer has room for any.
    pub fn receive<'b>(&mut self, buffer: &'b mut [u8]) -> &'b [u8] {
        let length = self.class.read_packet(buffer).unwrap_or(0);
        buffer.get(..length).unwrap_or_default()
    }

    /// Takes as many of these bytes as a packet holds, if the host has fetched the last one; tells how many.
    pub fn send(&mut self, bytes: &[u8]) -> usize {
        let packet = bytes.get(..SENT).unwrap_or(bytes);
        if packet.is_empty() { 0 } else { self.class.write_packet(packet).unwrap_or(0) }
    }
}

#[cfg(test)]
mod tests;
