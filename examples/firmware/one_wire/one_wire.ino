// DS18B20 probes on one wire (library DallasTemperature), each called by its address:
// ms=61000, T28FF641D93160314=21.56 C, T28FF0A2293160502=34.06 C
#include <DallasTemperature.h>
#include <OneWire.h>

const int DATA_PIN = 2;
const float POWER_ON = 85.0;  // shown before the first measurement
OneWire wire(DATA_PIN);
DallasTemperature probes(&wire);

void setup() {
  Serial.begin(115200);
  probes.begin();
  probes.setResolution(12);
}

void print(const DeviceAddress address) {
  Serial.print(", T");
  for (int i = 0; i < 8; i++) {
    if (address[i] < 16) Serial.print("0");
    Serial.print(address[i], HEX);
  }
  Serial.print("=");
  float celsius = probes.getTempC(address);
  if (celsius == DEVICE_DISCONNECTED_C || celsius == POWER_ON) Serial.print("nan");
  else Serial.print(celsius);
  Serial.print(" C");
}

void loop() {
  probes.requestTemperatures();  // waits 0.75 s for 12 bits
  Serial.print("ms=");
  Serial.print(millis());
  DeviceAddress address;
  for (int i = 0; i < probes.getDeviceCount(); i++)
    if (probes.getAddress(address, i)) print(address);
  Serial.println();
}
