"""The Modbus protocol: addresses, requests, messages on TCP and serial lines, and the link to a device."""
