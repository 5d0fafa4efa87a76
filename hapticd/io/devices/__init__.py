"""Touch and board devices: trackpad over HID, simulated trackpad, replayed reports, serial link."""
