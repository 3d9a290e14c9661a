'use strict';
stillwake.page = new stillwake.LivePage();
