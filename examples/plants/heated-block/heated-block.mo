model HeatedBlock "a heater in a metal block on a table in a room"
  parameter Real heater_capacity(unit = "J/K", min = 0.0) = 90.0;
  parameter Real block_capacity(unit = "J/K", min = 0.0) = 700.0;
  parameter Real table_capacity(unit = "J/K", min = 0.0) = 1500.0;
  parameter Real contact(unit = "W/K", min = 0.0) = 2.5 "between heater and block";
  parameter Real foot(unit = "W/K", min = 0.0) = 0.8 "between block and table";
  parameter Real block_loss(unit = "W/K", min = 0.0) = 0.9 "from the block to the room";
  parameter Real table_loss(unit = "W/K", min = 0.0) = 1.2 "from the table to the room";
  input Real power(unit = "W");
  input Real ambient(unit = "K");
  output Real heater_temperature(unit = "K", start = 293.15);
  output Real block_temperature(unit = "K", start = 293.15);
  output Real table_temperature(unit = "K", start = 293.15);
equation
  heater_capacity*der(heater_temperature) = power - contact*(heater_temperature - block_temperature);
  block_capacity*der(block_temperature) = contact*(heater_temperature - block_temperature) - foot*(block_temperature - table_temperature)
    - block_loss*(block_temperature - ambient);
  table_capacity*der(table_temperature) = foot*(block_temperature - table_temperature) - table_loss*(table_temperature - ambient);
end HeatedBlock;
